/** A job's row in a list. */

import { cardPicture } from "../film/job-look.js";
import { showImage } from "../news/images.js";
import { h, setFacts, setText } from "../base/dom.js";
import { scenes } from "../news/farm.js";
import { remove as removeJobs } from "./job-deeds.js";
import { ago, clock } from "../base/format.js";
import { icon } from "../base/icons.js";
import { lightWords } from "../base/light-words.js";
import { linkTo } from "../shell/router.js";
import { markBlack } from "../base/black-image.js";
import { offer } from "../news/projects.js";
import { askedBy } from "../news/session.js";
import { jobRowOf, keepShownImage, shownImage } from "../news/shown-images.js";
import { reached } from "../news/settings-table.js";
import { framesDone, isShot, shotName } from "../base/shot-words.js";
import { progressBar, stateChip } from "../shell/state-chip.js";
import { saidOf } from "../base/said.js";
import { timeLeft } from "../news/time-left.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/** Refresh interval of a running job's thumbnail. */
const PICTURE_EVERY_S = 5;

/** States of unfinished jobs. */
const OPEN = ["queued", "running", "paused"];

/** One clock for all rows, which come and go as a list is scrolled. */
setInterval(() => {
  for (const element of document.querySelectorAll("[data-since]"))
    setText(element, ago(Number(/** @type {HTMLElement} */ (element).dataset.since)));
}, 10_000);

/**
 * @param {Job} job
 * @param {HTMLElement} [lead] what stands before it
 * @returns {import("../base/dom.js").Row<Job>}
 */
export function jobRow(job, lead) {
  const name = h("a", { class: "name", href: linkTo("jobs", job.id) });
  const note = h("span", { class: "quiet small" });
  const size = h("span", { class: "facts-line" });
  const also = h("span", { class: "facts-line also" }); // in columns of their own where there are some
  const samples = h("span", { class: "quiet small number samples" });
  const by = h("span", { class: "quiet small by" });
  const late = h("span", { class: "late", hidden: true }, icon("clock"), t("late"));
  const chip = stateChip(job.state);
  const bar = progressBar(t("Progress"));
  const far = h("div", { class: "quiet small number" });
  const when = h("span", { class: "quiet small when number" });
  const image = shownImage(jobRowOf(job.id)) ?? h("img", { alt: "", hidden: true });
  image.addEventListener("load", () => ((image.hidden = false), keepShownImage(jobRowOf(job.id), image)));
  const box = h("div", { class: "picture" }, icon("image"), image);
  const remove = h(
    "button",
    { class: "icon-button danger delete for-submit", type: "button", onclick: () => removeJob(latest) },
    icon("trash"),
  );
  let latest = job;
  let picturedAt = -Infinity;
  let picturedState = "";

  const element = h(
    "li",
    { class: "job-row" },
    lead,
    box,
    h("div", { class: "title" }, h("div", { class: "called" }, name, note), h("div", { class: "quiet small number facts-line" }, late, size, also)),
    chip.element,
    h("div", { class: "bar" }, bar.element, far),
    samples,
    by,
    when,
    remove,
  );

  return {
    element,
    update(next) {
      latest = next;
      offer(element, next.project);
      setText(name, next.name);
      setText(note, next.note ?? "");
      note.title = next.note ?? "";
      remove.setAttribute("aria-label", t("Delete the picture of {name}", { name: next.name }));
      setFacts(size, next.width && next.height ? sizeLine(next) : []);
      setFacts(also, [next.width && next.height ? reached(next) : "", askedBy(next)].filter(Boolean));
      setText(samples, next.width && next.height ? reached(next) : "");
      setText(by, askedBy(next));
      by.title = askedBy(next);
      late.hidden = next.late == null || !OPEN.includes(next.state);
      chip.update(next.state);
      bar.update(next.state === "finished" ? 1 : next.progress, next.state);
      box.style.setProperty("--done", String(OPEN.includes(next.state) ? next.progress : 0));
      setText(far, progressLine(next));
      when.dataset.since = String(next.created);
      setText(when, ago(next.created));
      const now = performance.now() / 1000;
      const due = next.state !== picturedState || (next.state === "running" && now - picturedAt > PICTURE_EVERY_S);
      if (next.samples > 0 && due && !document.hidden) {
        picturedAt = now;
        picturedState = next.state;
        showImage(image, cardPicture(next)).then(
          () => (box.removeAttribute("title"), markBlack(box, image)),
          ({ message }) => ((image.hidden = true), (box.title = message)),
        );
      }
    },
  };
}

/** @param {Job} job @returns {string[]} */
function sizeLine(job) {
  const scene = scenes.value?.find(({ id }) => id === job.scene);
  const parts = [`${job.width}×${job.height}`, shotName(job, scene?.fps), lightWords(job.environment, scene), ...placeWords(job)];
  return parts.filter((part) => Boolean(part));
}

/** An open job's queue properties that differ from the defaults: priority, deadline. @param {Job} job */
function placeWords({ state, priority, deadline }) {
  if (!OPEN.includes(state)) return [];
  return [priority ? t("priority {n}", { n: priority }) : "", deadline != null ? t("by {time}", { time: new Date(deadline * 1000).toLocaleString([], { weekday: "short", hour: "2-digit", minute: "2-digit" }) }) : ""];
}

/** @param {Job} job */
function progressLine(job) {
  if (job.state === "failed") return saidOf(job, "error");
  if (job.message) return saidOf(job, "message");
  if (job.state === "finished") return t("took {time}", { time: clock(job.elapsed_s) });
  const done = isShot(job) && job.shot ? framesDone(job.shot) : `${Math.floor(job.progress * 100)} %`;
  const left = job.state === "running" && timeLeft(job.id);
  return left ? t("{done}, {time} left", { done, time: left }) : done;
}

/** @param {Job} job */
export function removeJob(job) {
  removeJobs([job.id], t("Picture of “{name}” deleted", { name: job.name }));
}
