/** The front page: a drop area, examples, and the existing scenes. */

import { listExamples, pictureOf, visitExample } from "../shell/examples.js";
import { getComparisons, openComparison } from "../compare/comparisons.js";
import { fill, h, keyedList } from "../base/dom.js";
import { arriving } from "../news/arriving.js";
import { hidden, jobs, scenes, workers } from "../news/farm.js";
import { choose } from "../shell/drops.js";
import { FIRST_STEPS } from "../shell/help-dialog.js";
import { emptyPage, noWorkerNotice } from "../shell/hints.js";
import { icon } from "../base/icons.js";
import { holdOnLongPress } from "../shell/long-press.js";
import { here, linkTo, setTitle } from "../shell/router.js";
import { chosenProject } from "../base/project.js";
import { mayChange } from "../news/projects.js";
import { parseFrames } from "../base/frame-numbers.js";
import { Disposer } from "../base/store.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { placeUploads, showError } from "../shell/tray.js";
import { jobRow } from "./job-row.js";
import { sceneGrid } from "./scene-grid.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Example} Example */

const RECENT_JOBS = 4;
/** Delay of changes of the scenes, in milliseconds: the page of an uploaded scene opens before the cards here move. */
const NEWS_MS = 300;
/** The most impressive examples come first; the others are sorted by name. */
const FIRST_EXAMPLES = ["still-life", "caterpillar", "christmas", "spheres", "cornell-box"];

/** The examples that were shown last. @type {{examples: Example[], comparisons: Awaited<ReturnType<typeof getComparisons>>} | null} */
let shown = null;

/** @returns {{element: HTMLElement, dispose: () => void}} */
export function homeView() {
  setTitle();
  const life = new Disposer();
  const notice = h("div", { class: "notice-slot" });
  const zone = dropZone();
  life.add(placeUploads(zone));
  const nothing = emptyPage("image", t("Nothing here yet"), t("Scenes and pictures that others share with you appear here."));
  nothing.hidden = true;
  const grid = sceneGrid();
  const sceneSection = section(t("Scenes"), grid.element, grid.aside);
  const exampleGrid = h("ul", { class: "cards" });
  const exampleSection = section(
    t("Examples"),
    exampleGrid,
    h("span", { class: "quiet small" }, t("No scene at hand? Start with one of these."), " ", h("a", { href: FIRST_STEPS }, t("First steps"))),
  );
  const comparisonList = h("ul", { class: "comparisons" });
  const comparisonSection = section(t("Comparisons"), comparisonList, h("span", { class: "quiet small" }, t("One scene, rendered in two ways.")));
  const jobList = h("ul", { class: "cards latest" });
  const jobSection = section(t("Latest pictures"), jobList, h("a", { class: "small", href: linkTo("jobs") }, t("All jobs")));
  for (const part of [sceneSection, exampleSection, comparisonSection, jobSection]) part.hidden = true;
  for (const part of [exampleSection, comparisonSection]) part.classList.add("for-submit"); // opening one requires permission to upload

  const showJobs = keyedList(
    jobList,
    (job) => job.id,
    (job) => {
      const row = jobRow(job);
      row.element.classList.add("card");
      holdOnLongPress(row.element);
      return row;
    },
  );

  const path = here().path.join();
  const refresh = () => {
    if (here().path.join() !== path) return; // another view is being opened, and the cards would move before it is here
    const seenScenes = (scenes.value ?? []).filter(({ id }) => !hidden.value.has(id));
    const seenJobs = (jobs.value ?? [])
      .filter((job) => !hidden.value.has(job.id))
      .slice(0, RECENT_JOBS);
    const several = arriving.value.length > 1 ? arriving.value : []; // the drop area shows a single upload
    grid.put(seenScenes, several);
    showJobs(seenJobs);
    zone.classList.toggle("compact", seenScenes.length > 0);
    nothing.hidden = mayChange(chosenProject()) || seenScenes.length + seenJobs.length > 0 || scenes.value === null;
    sceneSection.hidden = seenScenes.length + several.length === 0;
    jobSection.hidden = seenJobs.length === 0;
  };
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let news;
  life.add(() => clearTimeout(news));
  let isListed = false;
  const refreshSoon = () => {
    clearTimeout(news);
    news = setTimeout(refresh, NEWS_MS);
  };
  let uploads = 0;
  life.add(
    arriving.subscribe(({ length }) => {
      if (length > uploads) refresh();
      else if (length < uploads) refreshSoon();
      uploads = length;
    }),
  );
  life.add(
    scenes.subscribe((all) => {
      if (isListed) refreshSoon();
      else refresh();
      isListed = all !== null;
    }),
  );
  for (const store of [jobs, hidden])
    life.add(/** @type {import("../base/store.js").Store<any>} */ (store).subscribe(refresh));
  life.add(workers.subscribe((all) => fill(notice, all?.length === 0 && noWorkerNotice())));
  if (mayChange(chosenProject())) life.add(addShortcuts([{ keys: "U", does: t("Choose files"), run: () => choose({ folder: false }) }]));

  // Thumbnails of examples are large, so the existing scenes load first on a slow line.
  const told = new Promise((done) => life.add(scenes.subscribe((all) => all && done(null))));
  const listed = listExamples();
  listed.then(refresh, () => {}); // the section of the examples stays hidden
  const present = () => {
    if (!shown) return;
    const { examples, comparisons } = shown;
    const all = inOrder(examples);
    fill(exampleGrid, all.map(exampleCard));
    const pairs = all.flatMap((example) => (comparisons[example.name] ?? []).map((comparison) => comparisonItem(example, comparison)));
    fill(comparisonList, pairs);
    exampleSection.hidden = examples.length === 0;
    comparisonSection.hidden = pairs.length === 0;
  };
  present(); // as before, so that the page has its length and place at once
  Promise.all([listed, getComparisons(), told]).then(
    ([examples, comparisons]) => {
      const found = { examples, comparisons };
      if (JSON.stringify(found) === JSON.stringify(shown)) return;
      shown = found;
      present();
    },
    () => {}, // a service without examples: the section stays hidden
  );

  const element = h(
    "div",
    { class: "page home" },
    h("h1", { class: "visually-hidden" }, "Rayfarm"),
    zone,
    nothing,
    notice,
    jobSection,
    sceneSection,
    exampleSection,
    comparisonSection,
  );
  return { element, dispose: () => life.dispose() };
}

/** @param {Example[]} examples by name */
function inOrder(examples) {
  const place = (/** @type {Example} */ { name }) => (FIRST_EXAMPLES.indexOf(name) + FIRST_EXAMPLES.length + 1) % (FIRST_EXAMPLES.length + 1);
  return examples.toSorted((a, b) => place(a) - place(b));
}

function dropZone() {
  return h(
    "section",
    { class: "drop-zone for-submit", "aria-labelledby": "drop-title" },
    icon("upload"),
    h("h2", { id: "drop-title" }, matchMedia("(pointer: coarse), (max-width: 560px)").matches ? t("Open a scene") : t("Drop a scene anywhere on this page")),
    h(
      "p",
      { class: "quiet" },
      t("GLB, glTF, USD, FBX, BLEND, OBJ with its MTL and textures, 3MF, PLY, STL, DAE, 3DS and more, or a scene YAML; its folder or a zip will do."),
    ),
    h(
      "div",
      { class: "row" },
      h(
        "button",
        { class: "button primary", type: "button", onclick: () => choose({ folder: false }) },
        icon("image"),
        t("Choose files"),
      ),
      h(
        "button",
        { class: "button", type: "button", onclick: () => choose({ folder: true }) },
        icon("folder"),
        t("Choose a folder"),
      ),
    ),
    h("p", { class: "addon quiet small" }, h("a", { href: "/api/blender-addon.zip", download: "" }, t("Download the add-on for Blender"))),
  );
}

/** Removes a picture that does not exist, so that the placeholder is visible. @param {Event} event */
const removePicture = (event) => /** @type {HTMLElement} */ (event.target).remove();

/** @param {Example} example */
function exampleCard(example) {
  const picture = pictureOf(example);
  const length = example.frames && h("span", { class: "badge number" }, icon("play"), lengthOf(example.frames, example.fps));
  return h(
    "li",
    { class: "card example" },
    h("div", { class: "picture" }, icon("cube"), h("img", { src: picture, alt: "", loading: "lazy", onerror: removePicture }), length),
    h(
      "div",
      { class: "body" },
      h("button", { class: "name", type: "button", onclick: () => visitExample(example) }, example.title),
      h("p", { class: "quiet small" }, t(example.description)),
    ),
  );
}

/** Duration of a shot, such as "4 s". @param {string} frames @param {number | null} fps */
function lengthOf(frames, fps) {
  const numbers = parseFrames(frames);
  return typeof numbers === "string" || !fps ? t("shot") : `${Number((numbers.length / fps).toFixed(1))} s`;
}

/**
 * @param {Example} example
 * @param {import("../compare/comparisons.js").ExampleComparison} comparison
 */
function comparisonItem(example, comparison) {
  const run = async () => {
    button.disabled = true;
    try {
      await openComparison(example.name, comparison);
    } catch (error) {
      showError(t("“{title}” could not be opened", { title: t(comparison.title) }), error);
    } finally {
      button.disabled = false;
    }
  };
  const button = h("button", { class: "name", type: "button", onclick: run }, t(comparison.title));
  const about = [example.title, comparison.about && t(comparison.about)].filter(Boolean).join(": ");
  return h(
    "li",
    { class: "card comparison" },
    h("div", { class: "picture" }, icon("compare"), h("img", { src: pictureOf(example), alt: "", loading: "lazy", onerror: removePicture })),
    h("div", { class: "body" }, button, h("p", { class: "quiet small" }, about)),
  );
}

/**
 * @param {string} title
 * @param {HTMLElement} body
 * @param {HTMLElement} [aside]
 */
function section(title, body, aside) {
  return h("section", { class: "section", "aria-label": title }, h("header", null, h("h2", null, title), aside), body);
}
