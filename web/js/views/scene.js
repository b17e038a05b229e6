/** One scene: while it is prepared, when it failed, and when it is ready to be rendered. */

import { createJob, getScene, imageUrl } from "../news/api.js";
import { fill, h, keyedList, setText } from "../base/dom.js";
import { adoptJob, adoptScene, hidden, jobs, scenes, workers } from "../news/farm.js";
import { bytes, count, extent } from "../base/format.js";
import { emptyState, noWorkerNotice } from "../shell/hints.js";
import { icon } from "../base/icons.js";
import { isPassing } from "../news/passing.js";
import { go, here, linkTo, setTitle } from "../shell/router.js";
import { settingsForm } from "../scene/settings-form.js";
import { firstFrame } from "../base/shot-words.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { progressBar, stateChip } from "../shell/state-chip.js";
import { Disposer } from "../base/store.js";
import { announce, showError } from "../shell/tray.js";
import { addFiles, choose } from "../shell/uploads.js";
import { viewTurner } from "../scene/view-turner.js";
import { jobRow } from "./job-row.js";
import { removeScene, thumbnail } from "./scene-card.js";

/** @typedef {import("../base/types.js").Scene} Scene */

/**
 * @param {string} id
 * @returns {{element: HTMLElement, dispose: () => void}}
 */
export function sceneView(id) {
  setTitle("Scene");
  const life = new Disposer();
  const element = h("div", { class: "page scene-page" });
  /** @param {Error} error */
  const gone = ({ message }) =>
    fill(
      element,
      emptyState("cube", "This scene is not here", h("p", null, message), h("a", { href: linkTo() }, "To the scenes")),
    );

  let asked = false;
  /** @type {{status: string, update: (scene: Scene) => void} | null} */
  let part = null;
  life.add(
    scenes.subscribe((all) => {
      const scene = all?.find((candidate) => candidate.id === id);
      if (scene) {
        if (part?.status !== scene.status) {
          if (part && scene.status === "ready") announce(`${scene.name} is ready to render`);
          part = { status: scene.status, update: { preparing, failed, ready }[scene.status](element, scene, life) };
        }
        part.update(scene);
        setTitle(scene.name);
      } else if (all && !asked) {
        asked = true; // the list may be older than the scene
        getScene(id).then(adoptScene, gone);
      }
    }),
  );
  return { element, dispose: () => life.dispose() };
}

/** @param {Scene} scene */
function heading(scene) {
  return h(
    "header",
    { class: "scene-head" },
    h("a", { class: "icon-button", href: linkTo(), "aria-label": "All scenes" }, icon("back")),
    h("h1", { title: scene.name }, scene.name),
    h(
      "button",
      {
        class: "icon-button danger",
        type: "button",
        "aria-label": "Delete this scene",
        onclick: () => (removeScene(scene), go()),
      },
      icon("trash"),
    ),
  );
}

/**
 * @param {HTMLElement} page
 * @param {Scene} scene
 * @param {Disposer} life
 * @returns {(scene: Scene) => void}
 */
function preparing(page, scene, life) {
  const chip = stateChip("preparing");
  const step = h("p", { class: "quiet", "aria-live": "polite" });
  const bar = progressBar("Preparing");
  const notice = h("div", { class: "notice-slot" });
  life.add(workers.subscribe((all) => fill(notice, all?.length === 0 && noWorkerNotice())));
  fill(page, heading(scene), notice, h("section", { class: "preparing-panel panel" }, chip.element, bar.element, step));
  return (next) => {
    setText(step, next.step ?? "");
    bar.update(next.progress);
  };
}

/**
 * @param {HTMLElement} page
 * @param {Scene} scene
 * @returns {(scene: Scene) => void}
 */
function failed(page, scene) {
  fill(
    page,
    heading(scene),
    h(
      "div",
      { class: "notice error", role: "alert" },
      icon("warning"),
      h("div", null, h("strong", null, "This cannot be rendered. "), scene.error ?? ""),
    ),
    h(
      "section",
      { class: "section row" },
      h(
        "button",
        { class: "button primary", type: "button", onclick: () => choose({ folder: false }) },
        icon("upload"),
        "Upload it again",
      ),
      h(
        "button",
        { class: "button", type: "button", onclick: () => choose({ folder: true }) },
        icon("folder"),
        "Upload a folder",
      ),
      addButton(scene, scene.error),
    ),
  );
  return () => {};
}

/**
 * @param {HTMLElement} page
 * @param {Scene} scene
 * @param {Disposer} life
 * @returns {(scene: Scene) => void}
 */
function ready(page, scene, life) {
  const picture = thumbnail();
  const notice = h("div", { class: "notice-slot" });
  const list = h("ul", { class: "rows" });
  const pictures = h(
    "section",
    { class: "pictures", "aria-label": "Pictures of this scene" },
    h("h2", null, "Pictures of this scene"),
    list,
  );
  const showJobs = keyedList(
    list,
    (job) => job.id,
    (job) => jobRow(job),
  );
  const listJobs = () => {
    const own = (jobs.value ?? []).filter(
      (job) => job.scene === scene.id && !hidden.value.has(job.id) && !isPassing(job),
    );
    showJobs(own);
    pictures.hidden = own.length === 0;
    const finished = own.find(({ state }) => state === "finished");
    picture.update(scene, finished && imageUrl({ job: finished.id, frame: firstFrame(finished) }, "jpg", { width: 800, v: finished.samples }));
  };
  const submit = async (/** @type {import("../base/types.js").JobRequest} */ request) => {
    try {
      // One key a press: the request may be repeated by the network, but makes one job.
      const job = await createJob(request, crypto.randomUUID?.() ?? String(Math.random()));
      adoptJob(job);
      go("jobs", job.id);
    } catch (error) {
      showError("The picture was not started", error);
    }
  };
  const like = (jobs.value ?? []).find(({ id }) => id === here().params.get("like")) ?? null;
  const form = settingsForm(scene, submit, like, here().params.has("shot"));
  life.add(form.dispose);
  const view = turnable(picture.element, form, life);
  life.add(workers.subscribe((all) => (fill(notice, all?.length === 0 && noWorkerNotice()), form.update())));
  life.add(jobs.subscribe(() => (form.update(), listJobs())));
  life.add(hidden.subscribe(listJobs));
  life.add(
    addShortcuts([
      { keys: "R", does: "Render", run: () => form.element.requestSubmit() },
      { keys: "Enter", does: "Render", run: () => form.element.requestSubmit() },
    ]),
  );
  fill(
    page,
    heading(scene),
    notice,
    h(
      "div",
      { class: "scene-columns" },
      h("div", { class: "scene-about" }, view, warnings(scene), facts(scene), pictures),
      h("section", { class: "panel", "aria-label": "Render" }, form.element),
    ),
  );
  return () => {};
}

/**
 * The scene's picture, with a button that takes the view into the hand.
 *
 * @param {HTMLElement} picture
 * @param {import("../scene/settings-form.js").SettingsForm} form
 * @param {Disposer} life
 */
function turnable(picture, form, life) {
  /** @type {ReturnType<typeof viewTurner> | null} */
  let turner = null;
  const stop = () => {
    turner?.dispose();
    turner = null;
    fill(box, picture, button);
  };
  const start = () => {
    const { width = 1, height = 1 } = form.request();
    const seen = picture.querySelector("img")?.src ?? "";
    turner = viewTurner(form, width / height, seen, () => (stop(), button.focus()));
    fill(box, turner.element);
    /** @type {HTMLElement | null} */ (turner.element.querySelector(".turner"))?.focus({ preventScroll: true });
  };
  const button = h(
    "button",
    { class: "button turn-button", type: "button", onclick: start },
    icon("turn"),
    "Turn the view",
  );
  const box = h("div", { class: "view-box" }, picture, button);
  form.element.addEventListener("change", () => turner?.refresh());
  life.add(stop);
  return box;
}

/**
 * Where a sentence says that a file is missing: just that one need be sent.
 *
 * @param {Scene} scene
 * @param {string | null} sentences
 */
function addButton(scene, sentences) {
  if (!sentences?.includes("; add it")) return null;
  return h(
    "button",
    { class: "button", type: "button", onclick: () => addFiles(scene) },
    icon("plus"),
    "Add files",
  );
}

/** @param {Scene} scene */
function warnings(scene) {
  const sentences = scene.warnings;
  if (!sentences.length) return null;
  return h(
    "div",
    { class: "notice warning" },
    icon("warning"),
    h(
      "ul",
      { "aria-label": "Warnings" },
      sentences.map((sentence) => h("li", null, sentence)),
    ),
    addButton(scene, sentences.join(" ")),
  );
}

/** @param {Scene} scene */
function facts(scene) {
  /** @type {[string, string][]} */
  const rows = Object.entries(scene.counts)
    .filter(([, n]) => n > 0)
    .map(([name, n]) => [name[0]?.toUpperCase() + name.slice(1).replaceAll("_", " "), count(n)]);
  if (scene.cameras.length > 1) rows.push(["Cameras", count(scene.cameras.length - 1)]); // the automatic one left out
  const end = Math.max(0, ...(scene.clips ?? []).map((clip) => clip.end));
  if (end) rows.push(["Moves", `${Number(end.toFixed(2))} s at ${scene.fps} fps`]);
  if ((scene.clips?.length ?? 0) > 1) rows.push(["Clips", count(scene.clips?.length ?? 0)]);
  const [lo, hi] = scene.bounds ?? [];
  if (lo && hi) rows.push(["Extent", extent(hi.map((v, i) => v - (lo[i] ?? 0)))]);
  rows.push(["Files", bytes(scene.bytes)]);
  return h(
    "dl",
    { class: "facts tiles number" },
    rows.map(([name, value]) => h("div", null, h("dt", null, name), h("dd", null, value))),
  );
}
