/**
 * The stage that replaces the live view: one picture, or two at a wipe, of which one may be the live view. Same zoom and pixel
 * values as on a job's page.
 */

import { fill, h } from "../base/dom.js";
import { Disposer } from "../base/store.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { LiveFilm } from "../film/live-film.js";
import { pictureStage } from "../film/picture-stage.js";
import { getJob, imageUrl, thumbnailFormat } from "../news/api.js";
import { adoptJob, hidden, jobs } from "../news/farm.js";
import { linkTo } from "../shell/router.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { announce, showError } from "../shell/tray.js";
import { sideChoices, wordsOf } from "./side-choices.js";
import { LIVE, isCompared, jobOf } from "./sides.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("./sides.js").Sides} Sides */
/** @typedef {import("../base/store.js").Store<Sides>} SidesStore */
/** @typedef {{exposure: number, curve: string}} Look */

/**
 * @param {object} parts
 * @param {string} parts.scene
 * @param {SidesStore} parts.sides
 * @param {import("./view-film.js").ViewFilm} parts.live
 * @param {import("../base/store.js").Store<Look>} parts.look
 * @param {(a: Job, b: Job) => [string, string]} parts.names of two pictures, by what tells them apart
 * @param {(shown: {isOpen: boolean, hasLive: boolean}) => void} parts.changed
 * @returns {{element: HTMLElement, bar: HTMLElement, shown: () => HTMLElement | null, dispose: () => void}} element: the stage; bar: below it
 */
export function viewStage({ scene, sides, live, look, names, changed }) {
  const life = new Disposer();
  const element = h("div", { class: "view-stage", hidden: true });
  const choices = sideChoices(scene, sides);
  const swap = () => sides.update(({ a, b }) => (b ? { a: b, b: a } : { a, b }));
  const back = () => sides.set({ a: LIVE, b: "" });
  const compare = h("a", { class: "button small" }, icon("compare"), t("Compare"));
  const open = h("a", { class: "button small" }, icon("image"), t("Open"));
  const swapper = h(
    "button",
    { class: "icon-button", type: "button", "aria-label": t("Swap left and right"), title: t("Swap (X)"), onclick: swap },
    icon("swap"),
  );
  const status = h("div", null);
  const bar = h(
    "div",
    { class: "sides", hidden: true },
    status,
    h(
      "div",
      { class: "view-bar" },
      h("button", { class: "button small", type: "button", title: t("Back to the live view (Escape)"), onclick: back }, icon("back"), t("Live view")),
      choices.a,
      swapper,
      choices.b,
      h("span", { class: "grow" }),
      open,
      compare,
    ),
  );

  /** @type {{key: string, life: Disposer, stage: import("../film/picture-stage.js").PictureStage | null} | null} */
  let opened = null;
  const close = () => {
    opened?.life.dispose();
    opened = null;
    fill(element);
    fill(status);
  };
  /** @type {Set<string>} */
  const asked = new Set();
  let wipe = 0.5;
  /** @param {Job | null} a @param {Job | null} b null: the live view @param {boolean} isTwo */
  const begin = (a, b, isTwo) => {
    const own = new Disposer();
    const first = /** @type {Job} */ (a ?? b);
    const sideOf = (/** @type {Job | null} */ job) => {
      if (!job) return live;
      const film = new LiveFilm(job);
      own.add(() => film.dispose());
      return film;
    };
    const [left, right] = [sideOf(a), isTwo ? sideOf(b) : null];
    const called = a && b ? names(a, b) : [a, b].map((job) => (job ? wordsOf(job) : t("Live view")));
    const size = { width: first.width ?? 1, height: first.height ?? 1 };
    const arrange = () =>
      stage.arrange({
        left: { live: left, channel: "", name: `A: ${called[0]}` },
        right: right && { live: right, channel: "", name: `B: ${called[1]}` },
        wipe: right ? wipe : null,
      });
    const stage = pictureStage(size, own, { wiped: (at) => ((wipe = at), arrange()), changed: () => {} });
    if (stage.view) {
      stage.view.viewport.isSnug = true;
      if (stage.view.viewport.fitted) stage.view.fit();
    }
    if (a && a.samples > 0) stage.view?.setPoster(imageUrl({ job: a.id, frame: left.frame }, thumbnailFormat(a), { width: 240, v: a.samples }));
    arrange();
    own.add(look.subscribe((now) => stage.view?.setLook(now)));
    const zoom = (/** @type {1 | -1} */ way) => () => stage.view?.zoom(way);
    own.add(
      addShortcuts([
        { keys: "F", does: t("Fit the picture"), run: () => stage.view?.fit() },
        { keys: "1", does: t("One picture pixel per screen pixel"), run: () => stage.view?.actualSize() },
        { keys: "+", does: t("Zoom in"), run: zoom(1) },
        { keys: "-", does: t("Zoom out"), run: zoom(-1) },
        { keys: "X", does: t("Swap left and right"), run: swap },
      ], "view"),
    );
    fill(element, stage.element);
    fill(status, stage.statusBar);
    announce(isTwo ? t("A: {a}. B: {b}.", { a: called[0] ?? "", b: called[1] ?? "" }) : t("Shown: {name}", { name: called[0] ?? "" }));
    return { life: own, stage };
  };
  const show = () => {
    const { a, b } = sides.value;
    const [jobA, jobB] = [jobOf(a), jobOf(b)];
    const wanted = [a, b].filter((id) => id && id !== LIVE);
    for (const id of wanted) {
      const isKnown = jobs.value?.some((job) => job.id === id);
      if (!jobs.value || isKnown || asked.has(id)) continue;
      asked.add(id); // the list contains only the newest ones
      getJob(id).then(adoptJob, (error) => (showError(t("This picture is not here"), error), back()));
      return;
    }
    if (wanted.some((id) => hidden.value.has(id))) {
      back();
      return;
    }
    const isOpen = isCompared(sides.value) && Boolean(jobA || jobB);
    const key = isOpen ? `${a} ${b}` : "";
    choices.update();
    if (key === (opened?.key ?? "")) return;
    close();
    element.hidden = bar.hidden = !isOpen;
    if (isOpen) {
      opened = { key, ...begin(jobA, jobB, b !== "") };
      const shown = jobA ?? jobB;
      if (shown) open.href = linkTo("jobs", shown.id);
      compare.href = jobA && jobB ? linkTo("compare", jobA.id, jobB.id) : linkTo("compare", shown?.id ?? "");
      swapper.hidden = b === "";
    }
    changed({ isOpen, hasLive: a === LIVE || b === LIVE });
  };
  life.add(sides.subscribe(show));
  life.add(jobs.subscribe(show));
  life.add(hidden.subscribe(show));
  life.add(close);
  return { element, bar, shown: () => opened?.stage?.view?.element ?? null, dispose: () => life.dispose() };
}
