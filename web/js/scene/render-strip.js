/**
 * The strip of a scene's pictures: a click shows one as A instead of the view, Shift and a click as B beside it; its link opens
 * its page. (No double click: the first click changes the layout, and the strip moves.)
 */

import { lookOfJob } from "../film/job-look.js";
import { imageUrl, thumbnailFormat } from "../news/api.js";
import { showImage } from "../news/images.js";
import { h, keyedList, setText } from "../base/dom.js";
import { hidden, jobs } from "../news/farm.js";
import { firstFrame } from "../base/shot-words.js";
import { icon } from "../base/icons.js";
import { linkTo } from "../shell/router.js";
import { announce } from "../shell/tray.js";
import { asA, asB, jobOf } from "./sides.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("./sides.js").Sides} Sides */

/** Refresh interval of a picture being rendered. */
const PICTURE_EVERY_MS = 5000;
const MOST = 60;

/**
 * @param {string} scene
 * @param {import("../base/store.js").Store<Sides>} sides
 * @param {import("../base/store.js").Disposer} life
 * @param {() => boolean} isHeld whether it stays as it is: it would move the view while a job is started
 */
export function renderStrip(scene, sides, life, isHeld) {
  const list = h("ul", { class: "strip" });
  const hint = h("span", { class: "small quiet strip-hint" }, t("Click a picture to show it, Shift-click another to compare."));
  const title = h("h2", { class: "strip-title" }, t("Pictures of this scene"));
  const element = h(
    "section",
    { class: "pictures", "aria-label": t("Pictures of this scene"), hidden: true },
    title,
    hint,
    list,
  );
  /** @param {Job} job @param {MouseEvent} event */
  const clicked = ({ id }, event) => {
    if (jobOf(id)) sides.update((now) => (event.shiftKey ? asB(now, id) : asA(now, id)));
    else announce(t("There is nothing to show yet."));
  };
  const show = keyedList(
    list,
    (/** @type {Job} */ job) => job.id,
    (job) => tile(job, (event) => clicked(job, event), () => sides.value),
  );
  const update = () => {
    if (isHeld()) return;
    const own = (jobs.value ?? []).filter((job) => job.scene === scene && !hidden.value.has(job.id)).slice(0, MOST);
    show(own);
    element.hidden = own.length === 0;
  };
  life.add(jobs.subscribe(update));
  life.add(hidden.subscribe(update));
  life.add(sides.subscribe(update));
  return element;
}

/**
 * @param {Job} job
 * @param {(event: MouseEvent) => void} clicked
 * @param {() => Sides} sides
 * @returns {import("../base/dom.js").Row<Job>}
 */
function tile(job, clicked, sides) {
  const image = h("img", { alt: "", hidden: true });
  image.addEventListener("load", () => (image.hidden = false));
  const about = h("span", { class: "strip-about small number" });
  const letter = h("span", { class: "letter", "aria-hidden": "true", hidden: true });
  const button = h(
    "button",
    { class: "strip-tile", type: "button", onclick: clicked },
    h("span", { class: "strip-picture" }, icon("image"), image, letter),
    about,
  );
  button.dataset.job = job.id;
  const open = h("a", { class: "strip-open", href: linkTo("jobs", job.id), title: t("Open its page") }, icon("next"));
  let shown = "";
  let at = -Infinity;
  return {
    element: h("li", null, button, open),
    update(next) {
      const words = aboutOf(next);
      const { a, b } = sides();
      const side = a === next.id ? "A" : b === next.id ? "B" : "";
      setText(about, words);
      button.classList.toggle("finished", next.state === "finished");
      setText(letter, side);
      letter.hidden = !side;
      button.setAttribute("aria-pressed", String(side !== ""));
      const name = `${next.name}, ${words}`;
      button.setAttribute("aria-label", side ? t("{name}, shown as {side}", { name, side }) : name);
      open.setAttribute("aria-label", t("Open {name}", { name }));
      const isNew = next.samples > 0 && shown !== `${next.state}`;
      if (!isNew && !(next.state === "running" && performance.now() - at > PICTURE_EVERY_MS)) return;
      if (next.samples <= 0) return;
      shown = next.state;
      at = performance.now();
      showImage(image, imageUrl({ job: next.id, frame: firstFrame(next) }, thumbnailFormat(next), { width: 240, visible: "true", ...lookOfJob(next), v: next.samples })).then(
        () => (button.title = name),
        ({ message }) => ((image.hidden = true), (button.title = message)),
      );
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
