/** The pictures of a scene in a strip: a click opens one, Shift and a click compares it with the one that was clicked before. */

import { imageUrl } from "../news/api.js";
import { h, keyedList, setText } from "../base/dom.js";
import { hidden, jobs } from "../news/farm.js";
import { firstFrame } from "../base/shot-words.js";
import { icon } from "../base/icons.js";
import { go, linkTo } from "../shell/router.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/** A picture that is being rendered is renewed this often. */
const PICTURE_EVERY_MS = 5000;
const MOST = 60;

/**
 * @param {string} scene
 * @param {import("../base/store.js").Disposer} life
 */
export function renderStrip(scene, life) {
  const list = h("ul", { class: "strip" });
  const hint = h("span", { class: "small quiet" }, t("Shift and a click on two of them compares"));
  const title = h("h2", { class: "strip-title" }, t("Pictures of this scene"));
  const element = h(
    "section",
    { class: "pictures", "aria-label": t("Pictures of this scene"), hidden: true },
    h("div", { class: "row" }, title, h("span", { class: "grow" }), hint),
    list,
  );
  /** The first of two that are to be compared. @type {string | null} */
  let first = null;
  const mark = () => {
    for (const each of list.querySelectorAll("a"))
      each.classList.toggle("marked", first !== null && each.dataset.job === first);
    setText(hint, first ? t("Shift-click another to compare") : t("Shift and a click on two of them compares"));
  };
  const show = keyedList(
    list,
    (/** @type {Job} */ job) => job.id,
    (job) =>
      tile(job, (event) => {
        if (!event.shiftKey) return;
        event.preventDefault();
        if (first && first !== job.id) go("compare", first, job.id);
        first = first === job.id ? null : job.id;
        mark();
      }),
  );
  const update = () => {
    const own = (jobs.value ?? []).filter((job) => job.scene === scene && !hidden.value.has(job.id)).slice(0, MOST);
    show(own);
    element.hidden = own.length === 0;
    hint.hidden = own.length < 2;
  };
  life.add(jobs.subscribe(update));
  life.add(hidden.subscribe(update));
  return element;
}

/**
 * @param {Job} job
 * @param {(event: MouseEvent) => void} clicked
 * @returns {import("../base/dom.js").Row<Job>}
 */
function tile(job, clicked) {
  const image = h("img", { alt: "", hidden: true });
  image.addEventListener("load", () => (image.hidden = false));
  const about = h("span", { class: "strip-about small number" });
  const anchor = h(
    "a",
    { class: "strip-tile", href: linkTo("jobs", job.id), onclick: clicked },
    h("span", { class: "strip-picture" }, icon("image"), image),
    about,
  );
  anchor.dataset.job = job.id;
  let shown = "";
  let at = -Infinity;
  return {
    element: h("li", null, anchor),
    update(next) {
      setText(about, aboutOf(next));
      anchor.setAttribute("aria-label", `${next.name}, ${aboutOf(next)}`);
      const isNew = next.samples > 0 && shown !== `${next.state}`;
      if (!isNew && !(next.state === "running" && performance.now() - at > PICTURE_EVERY_MS)) return;
      if (next.samples <= 0) return;
      shown = next.state;
      at = performance.now();
      image.src = imageUrl({ job: next.id, frame: firstFrame(next) }, "jpg", { width: 240, v: next.samples });
    },
  };
}

/** @type {Record<string, string>} */
const ENDED = { queued: t("queued"), paused: t("paused"), failed: t("failed"), cancelled: t("cancelled") };

/** @param {Job} job */
function aboutOf(job) {
  if (job.state === "running") return `${Math.floor(job.progress * 100)} %`;
  if (job.state !== "finished") return ENDED[job.state] ?? job.state;
  return job.width && job.height ? `${job.width}×${job.height}` : t("finished");
}
