/** A job's progress and actions: pause, resume, cancel, more samples. */

import { beginAnew, changeJob } from "../news/api.js";
import { fill, h, setText } from "../base/dom.js";
import { putJob } from "../news/farm.js";
import { mayChange, readOnlyReason } from "../news/projects.js";
import { clock, compact, count, roughly } from "../base/format.js";
import { command } from "../shell/hints.js";
import { Elapsed } from "./elapsed.js";
import { go, here, linkTo } from "../shell/router.js";
import { icon } from "../base/icons.js";
import { endOf, settingOf, valueText } from "../news/settings-table.js";
import { framesDone, isShot } from "../base/shot-words.js";
import { leftText, rounded, timeLeft } from "../news/time-left.js";
import { showError, undoable } from "../shell/tray.js";
import { saidOf } from "../base/said.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/** Limits of additional samples per pixel: fewer are not visible, more take too long. */
const [FEWEST_MORE, MOST_MORE] = [16, 4096];
/** Maximum number of discarded samples listed. */
const BAD_NAMED = 3;
/** States from which a job can continue with its film. */
const STOPPED = ["paused", "cancelled", "failed"];

/**
 * @param {Job} job
 * @param {Parameters<typeof changeJob>[1]} change
 * @param {string} failure
 */
export async function change(job, change, failure) {
  if (!mayChange(job.project)) {
    showError(failure, readOnlyReason(job.project), { brief: true }); // requested by a key
    return;
  }
  try {
    putJob(await changeJob(job.id, change));
  } catch (error) {
    showError(failure, error);
  }
}

/**
 * Starts the picture again in a new job if the kind of workers no longer exists, after a few seconds for undoing.
 *
 * @param {Job} job
 * @param {HTMLElement} button
 */
function beginAnewUndoably(job, button) {
  button.setAttribute("disabled", "");
  const done = () => button.removeAttribute("disabled");
  undoable(t("“{name}” starts over", { name: job.name }), {
    commit: () =>
      void beginAnew(job.id)
        .then((made) => {
          putJob(made);
          if (here().path.join("/") === `jobs/${job.id}`) go("jobs", made.id);
        })
        .catch((error) => showError(t("“{name}” could not be started over", { name: job.name }), error))
        .finally(done),
    undo: done,
  });
}

/** Progress in numbers, which continue between the service's messages. @param {() => number | null} finishing seconds until the last denoised picture of a job without further samples; null: none is awaited */
export function progressPanel(finishing) {
  const samples = h("strong", { class: "big number" });
  const of = h("span", { class: "quiet number" });
  const elapsed = h("dd");
  const left = h("dd");
  const leftRow = h("div", null, h("dt", null, t("Left")), left);
  const speed = h("dd");
  const message = h("p", { class: "quiet small", role: "status", hidden: true });
  const anew = h(
    "button",
    { class: "button small for-submit", type: "button", hidden: true, onclick: () => latest && beginAnewUndoably(latest, anew) },
    icon("refresh"),
    t("Start over"),
  );
  const error = h("div", { class: "notice error", role: "alert", hidden: true });
  const bad = h("div", { class: "quiet small", hidden: true });
  const taken = h("p", { class: "quiet small", hidden: true });
  let shownTaken = "";
  /** @type {Job | null} */
  let latest = null;
  const time = new Elapsed();
  /** @type {string | null} */
  let shownError = null;
  let shownBad = 0;
  const tick = () => {
    if (!latest) return;
    const last = latest.state === "finished" ? finishing() : null;
    setText(elapsed, clock(time.seconds(last !== null)));
    setText(left, last !== null ? leftText(rounded(last)) : latest.state === "running" ? timeLeft(latest.id) || "…" : "–");
    leftRow.hidden = latest.state === "finished" && last === null;
  };
  return {
    element: h(
      "section",
      { class: "side-section stack", "aria-label": t("Progress") },
      h("div", { class: "row baseline" }, samples, of),
      h(
        "dl",
        { class: "figures number" },
        h("div", null, h("dt", null, t("Elapsed")), elapsed),
        leftRow,
        h("div", null, h("dt", null, t("Samples/s")), speed),
      ),
      taken,
      message,
      anew,
      error,
      bad,
    ),
    tick,
    /** @param {Job} job */
    update(job) {
      latest = job;
      time.update(job);
      const pixels = (job.width ?? 1) * (job.height ?? 1);
      setText(samples, isShot(job) ? count(job.shot?.states.finished ?? 0) : perPixel(job.samples / pixels));
      setText(of, goal(job));
      const rate = job.samples_per_s || (job.state !== "queued" && job.active_s > 0.5 ? (job.samples - samplesTaken(job)) / job.active_s : 0);
      setText(speed, rate >= 1 ? compact(rate) : "–");
      message.hidden = !job.message;
      setText(message, saidOf(job, "message"));
      anew.hidden = !job.stranded;
      error.hidden = !job.error;
      if (job.error !== shownError) {
        shownError = job.error; // an alert that is written again is read out again
        fill(error, icon("warning"), h("div", { class: "grow" }, saidOf(job, "error"), job.reproduce && command(job.reproduce)));
      }
      const from = takenSentence(job);
      taken.hidden = !from;
      if (from !== shownTaken) {
        shownTaken = from;
        const link = job.taken && { href: linkTo("jobs", job.taken.job) };
        fill(taken, from, " ", link && h("a", link, t("That job")));
      }
      bad.hidden = job.bad_samples === 0;
      if (job.bad_samples !== shownBad) {
        shownBad = job.bad_samples;
        const replay = job.frames?.[0]?.bad?.[0]?.reproduce;
        fill(
          bad,
          h("p", null, badSentence(job)),
          replay && h("p", null, t("To follow the first one:")),
          replay && command(replay),
        );
      }
      tick();
    },
  };
}

/** @param {number} samples per pixel @returns {string} below one with a digit, since there is a picture */
const perPixel = (samples) => (samples > 0 && samples < 1 ? Math.max(0.1, Math.floor(10 * samples) / 10).toLocaleString() : count(Math.floor(samples)));

/** @param {Job} job */
function badSentence({ bad_samples: n, frames }) {
  const where = (frames?.[0]?.bad ?? [])
    .slice(0, BAD_NAMED)
    .map(({ x, y, sample }) => t("pixel {x}, {y} sample {sample}", { x, y, sample }));
  const first = where.length ? t(" First: {places}.", { places: where.join("; ") }) : "";
  return tn(n, "{n} sample was not a number and was left out.", "{n} samples were not numbers and were left out.") + first;
}

/** @param {Job} job @returns {number} of all pixels, with which it began */
const samplesTaken = ({ taken, width, height }) => taken?.samples ?? (taken?.spp ?? 0) * (width ?? 1) * (height ?? 1);

/** @param {Job} job @returns {string} with what of an earlier job it began; empty where with nothing */
function takenSentence({ taken, spp, noise }) {
  if (!taken) return "";
  if (taken.frames) {
    const n = count(Math.round(taken.spp));
    return t("Taken from earlier jobs of the same shot: the frames {frames}, with {n} samples per pixel.", { frames: shortened(taken.frames), n });
  }
  if (noise != null || !spp) return t("Taken from an earlier job of the same picture: {n} samples per pixel.", { n: count(Math.round(taken.spp)) });
  return t("Taken from an earlier job of the same picture: {n} of {of} samples per pixel.", { n: count(Math.round(taken.spp)), of: count(spp) });
}

/** @param {string} frames as 0-9,12 */
const shortened = (frames) => (frames.length <= 40 ? frames.replaceAll(",", ", ") : `${frames.slice(0, 40).replace(/,[^,]*$/, "").replaceAll(",", ", ")}, …`);

/** @param {Job} job what "12" samples are out of */
function goal(job) {
  if (isShot(job) && job.shot) return `${framesDone(job.shot).replace(/^[\d,]+ /, "")}, ${endOf(job)}`;
  if (job.noise != null) return t("samples per pixel, until the noise is {noise}", { noise: valueText(settingOf("work", "noise"), job.noise) });
  if (job.seconds != null) return t("samples per pixel, for {time}", { time: clock(job.seconds) });
  return tn(job.spp ?? 0, "of {n} sample per pixel", "of {n} samples per pixel", { n: count(job.spp ?? 0) });
}

/** @returns {{element: HTMLElement, update: (job: Job) => void}} */
export function actionsPanel() {
  /** @type {Job | null} */
  let latest = null;
  /** @param {import("../base/icons.js").IconName} symbol @param {string} label @param {(job: Job) => void} run @param {string} [style] */
  const button = (symbol, label, run, style = "") =>
    h(
      "button",
      { class: `button ${style}`, type: "button", onclick: () => latest && run(latest) },
      icon(symbol),
      label,
    );
  const pause = button("pause", t("Pause"), pauseOrResume);
  const resume = button("play", t("Resume"), pauseOrResume, "primary");
  const cancel = button(
    "stop",
    t("Cancel"),
    (job) => change(job, { state: "cancelled" }, t("The job was not cancelled")),
    "danger",
  );
  cancel.title = t("Stops rendering; the picture so far stays");
  const number = h("span", { class: "number" });
  const more = button("plus", "", moreSamples);
  more.append(number);
  const adds = t("Adds samples: the picture is the same as if all had been requested at once");
  const element = h("div", { class: "row actions for-submit" }, resume, pause, cancel, more);
  return {
    element,
    update(job) {
      latest = job;
      const focused = [pause, resume, cancel].find((button) => button === document.activeElement);
      const open = ["queued", "running", "paused"].includes(job.state);
      pause.hidden = !open || job.state === "paused";
      resume.hidden = !STOPPED.includes(job.state);
      cancel.hidden = !open;
      more.hidden = job.state === "failed";
      setText(number, tn(asManyAgain(job), "{n} sample", "{n} samples", { n: count(asManyAgain(job)) }));
      const isKnown = job.state === "finished" && !job.taken && job.active_s >= 1 && asManyAgain(job) === job.spp;
      more.title = [adds, isKnown && t("Takes {time}, as this picture did.", { time: roughly(job.elapsed_s) })].filter(Boolean).join(". ");
      // Moves the focus if the pressed button disappears.
      if (focused?.hidden) [resume, pause, more].find((button) => !button.hidden)?.focus();
    },
  };
}

/** The button that keeps a job's files whatever the farm's retention rules. @returns {{element: HTMLElement, update: (job: Job) => void}} */
export function keepButton() {
  /** @type {Job | null} */
  let latest = null;
  const run = () => latest && change(latest, { pinned: !latest.pinned }, t("The job was not changed"));
  const title = t("Keep: never deleted automatically, nor the files of its scene");
  const element = h("button", { class: "icon-button keep for-submit", type: "button", title, onclick: run }, icon("keep"), h("span", null, t("Keep")));
  return {
    element,
    update(job) {
      latest = job;
      element.setAttribute("aria-pressed", String(Boolean(job.pinned)));
    },
  };
}

/** @param {Job} job */
export function pauseOrResume(job) {
  if (STOPPED.includes(job.state)) void change(job, { state: "running" }, t("The job was not resumed"));
  else if (job.state === "running" || job.state === "queued")
    void change(job, { state: "paused" }, t("The job was not paused"));
}

/** Number of samples that reduces the noise by 30 %: as many as requested, or as a pixel has. @param {Job} job */
function asManyAgain({ spp, noise, seconds, samples, width, height, shot }) {
  const pixels = Math.max((width ?? 1) * (height ?? 1) * (shot?.count ?? 1), 1);
  const has = 2 ** Math.round(Math.log2(Math.max(samples / pixels, 1)));
  const asked = spp && noise == null && seconds == null ? spp : has;
  return Math.min(Math.max(asked, FEWEST_MORE), MOST_MORE);
}

/** @param {Job} job */
export function moreSamples(job) {
  const stopped = job.state === "cancelled";
  void change(
    job,
    { more: asManyAgain(job), ...(stopped && { state: /** @type {const} */ ("running") }) },
    t("No samples were added"),
  );
}
