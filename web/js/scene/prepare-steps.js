/** The steps from an upload to the first picture, each with the time that it took. */

import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { jobs } from "../news/farm.js";
import { uploadSeconds } from "../news/upload-times.js";
import { t } from "../base/words.js";
import { renderingWords } from "./clarity.js";
import { isViewDenoised } from "./denoise-view.js";

/** @typedef {import("../base/types.js").Scene} Scene */

export const STEPS = /** @type {const} */ (["upload", "read", "build", "compile", "render", "denoise"]);

/** @typedef {(typeof STEPS)[number]} Step */

/** @type {Record<Step, string>} */
const LABELS = { upload: t("Upload"), read: t("Read"), build: t("Build"), compile: t("Compile renderer"), render: t("Render"), denoise: t("Denoise") };

/** What a step does, where the list is folded into a line; the others are counted. @type {Record<Exclude<Step, "render" | "denoise">, string>} */
const DOING = { upload: t("Uploading …"), read: t("Reading …"), build: t("Building …"), compile: t("Compiling the renderer, about half a minute …") };

/** Fractions of a preparation from which a scene is built, and rendered (worker/reading/prepare.py). */
const [BUILT_FROM, RENDERED_FROM] = [0.3, 0.85];

/** Returns the step that a scene's preparation is at; null while it waits for a worker. @param {Pick<Scene, "progress" | "codes">} scene @returns {Step | null} */
export function stepOf({ progress, codes }) {
  if (codes?.["step"]?.code === "compiling-renderer") return "compile";
  if (!progress) return null;
  return progress < BUILT_FROM ? "read" : progress < RENDERED_FROM ? "build" : "render";
}

/** Seconds after which a step's time is explained, and after which compiling takes longer than is usual. */
const [SLOW_S, COMPILED_S] = [2, 60];

/** Returns why a step takes its time, as far as the page knows. @param {number} seconds so far */
function reasonOf(seconds) {
  const isBusy = seconds > SLOW_S && jobs.value?.some(({ state }) => state === "running");
  return isBusy ? t("while a picture is being rendered") : "";
}

/** @param {number} seconds so far */
const compileWords = (seconds) => (seconds < COMPILED_S ? t("first time, about half a minute") : t("first time, on a busy machine"));

/** Times of the steps of one preparation, as the page hears of them. */
export class StepTimes {
  /** @param {number | null} upload seconds, null if this page did not upload it */
  constructor(upload) {
    /** Seconds of finished steps. @type {Partial<Record<Step, number>>} */
    this.took = upload === null ? {} : { upload };
    /** @type {Step | null} */
    this.step = null;
    this.since = 0;
  }

  /** @param {Step | null} step @param {number} now seconds */
  put(step, now) {
    if (step === this.step || (step && this.step && STEPS.indexOf(step) < STEPS.indexOf(this.step))) return;
    if (this.step) this.took[this.step] = now - this.since;
    [this.step, this.since] = [step, now];
  }

  /** Goes on with rendering after the camera was turned while its picture was denoised. @param {number} now seconds */
  renderAgain(now) {
    if (this.step !== "denoise") return;
    [this.step, this.since] = ["render", now - (this.took.render ?? 0)];
    delete this.took.render;
  }
}

/** "0.4 s", "12 s". @param {number} seconds */
export const secondsText = (seconds) => t("{n} s", { n: seconds < 10 ? seconds.toFixed(1) : Math.round(seconds) });

/**
 * The list of the steps, over the view from the upload until the first picture. Once the view shows the scene, the list is folded behind a
 * small button, and the view says the present step in a line.
 *
 * @param {string} scene its id
 */
export function prepareSteps(scene) {
  const times = new StepTimes(uploadSeconds.get(scene) ?? null);
  let isOver = false;
  /** What rendering is doing, and whether the picture is denoised after it. */
  let [doing, isSentence, isDenoised] = ["", false, isViewDenoised()];
  /** The part of the samples that the picture needs to be shown. */
  let share = 0;
  const list = h("ol", { class: "steps small number" });
  const element = h("details", { class: "view-steps", open: true }, h("summary", { title: t("Steps to the first picture"), "aria-label": t("Steps to the first picture") }, icon("down")), list);
  let isFolded = false;
  const now = () => performance.now() / 1000;
  const tick = () => {
    const at = times.step ? STEPS.indexOf(times.step) : 0;
    const row = (/** @type {Step} */ step, /** @type {number} */ i) => {
      const isCurrent = step === times.step;
      const isDone = step === "upload" || i < at;
      const took = isCurrent ? now() - times.since : times.took[step];
      // The page does not show an upload by another one, or of an example; skipped steps were already done.
      if (["upload", "compile"].includes(step) && !isCurrent && took === undefined) return null;
      if (step === "denoise" && !isDenoised) return null;
      const hint = isCurrent && h("span", { class: "quiet small" }, step === "compile" ? compileWords(took ?? 0) : (step === "render" && doing) || reasonOf(took ?? 0));
      if (hint && step === "render" && isSentence) hint.classList.add("note");
      return h(
        "li",
        { class: isCurrent ? "current" : isDone ? "done" : "", "aria-current": isCurrent ? "step" : null },
        icon(isCurrent ? "clock" : isDone ? "check" : "later"),
        h("span", { class: "grow" }, LABELS[step], " ", hint),
        took !== undefined && h("span", { class: "quiet" }, secondsText(took)),
      );
    };
    fill(list, ...STEPS.map(row));
  };
  return {
    element,
    tick,
    /** Folds the list, once the view shows the scene. Returns false if it was folded before. */
    fold() {
      if (isFolded) return false;
      isFolded = true;
      element.classList.add("folded");
      element.open = false;
      return true;
    },
    /** The present step as a line in place of the folded list; "": the list says it, or is over. */
    get line() {
      if (isOver || !isFolded || !times.step) return "";
      return times.step === "render" || times.step === "denoise" ? renderingWords(share, isDenoised) : DOING[times.step];
    },
    /** @param {Scene} next */
    update(next) {
      times.put(stepOf(next), now());
      tick();
    },
    /** The present step as the list names it; empty before the first. */
    get word() {
      return times.step ? LABELS[times.step] : "";
    },
    /** Whether this page follows an upload whose first picture has not been seen. */
    get isOpen() {
      return !isOver && (times.step !== null || uploadSeconds.has(scene));
    },
    /** Shows the last step, after the preparation. */
    render() {
      times.put("render", now());
      tick();
    },
    /**
     * Says how far the picture is.
     *
     * @param {number} part of the samples that the picture needs to be shown
     * @param {string} message why there are no new ones; "": there are
     * @param {boolean} denoises whether the picture is denoised after it
     */
    follow(part, message, denoises) {
      share = part;
      doing = message || t("{n} %", { n: Math.floor(100 * Math.min(part, 1)) });
      isSentence = message !== "";
      isDenoised = denoises;
      if (denoises && part >= 1 && times.step) times.put("denoise", now());
      else times.renderAgain(now());
    },
    /** The first picture is seen. */
    end() {
      isOver = true;
      uploadSeconds.delete(scene);
      element.remove();
    },
  };
}
