/** The noise of the live view, and its target noise, measured as a job's. */

import { h } from "../base/dom.js";
import { t, tn } from "../base/words.js";

/** State of a view before its first picture. */
export const PREPARING = t("Preparing the view …");
/** Relative noise levels; the second is the default. */
const LEVELS = [0.05, 0.02, 0.01];
const DEFAULT = 0.02;
/** @type {Record<number, string>} */
const HOW = { 0.05: t("Quick"), 0.02: t("Clear"), 0.01: t("Clearest") };
const MOST = 256; // samples a pixel of a view
const KEY = "rayfarm-view-noise";

/**
 * Returns the words for the view's own picture. They contain no estimate of its final samples, which changes as the noise is measured.
 *
 * @param {number} samples a pixel of the picture that is shown; 0: there is none
 * @param {number | null} noise relative; null: unknown with so few samples
 * @param {boolean} isDone
 * @param {boolean} isDenoised
 */
export function clarity(samples, noise, isDone, isDenoised) {
  if (!samples) return t("Waiting for the first samples …");
  const n = samples < 1 ? Number(samples.toPrecision(1)) : Math.round(samples);
  const seen = isDenoised ? t("denoised") : noise === null ? "" : t("{noise} noise", { noise: percent(noise) });
  return [tn(n, "{n} sample", "{n} samples"), seen, isDone && t("done")].filter(Boolean).join(", ");
}

/**
 * Returns the words for a stand-in of the view's picture.
 *
 * @param {boolean} isDone
 * @param {boolean} isOtherLight whether the stand-in has another light
 * @param {number} [mean] samples per pixel that the view's picture has so far
 * @param {number} [needed] samples per pixel with which it is shown
 * @param {boolean} [denoises] whether it is denoised before
 */
export function previewWords(isDone, isOtherLight, mean = 0, needed = 0, denoises = false) {
  if (isOtherLight) return t("New light: rendering …");
  if (isDone) return t("Preview");
  const n = Math.round(mean);
  if (n > 0 && n < needed) return t("Preview, rendering {n} of {all}", { n, all: needed });
  return denoises && n > 0 && needed > 0 ? t("Preview, denoising …") : t("Preview, rendering …");
}

/** The words for a view of a scene of which nothing can be seen from any side. */
export const nothingWords = t("Nothing visible");

/** The words for a small picture of the first samples. */
export const roughWords = t("Rough picture, rendering …");

/** Returns how far the view is; "" while that is unknown. @param {number} mean samples a pixel so far @param {number | null} noise after these */
export function progressWords(mean, noise) {
  const [n, all] = [Math.round(mean), samplesFor(mean, noise)];
  return all > n ? t("{n} of about {all} samples", { n, all }) : "";
}

/** Returns the estimated samples per pixel of the selected level; 0: unknown. @param {number} mean samples per pixel so far @param {number | null} noise after these */
function samplesFor(mean, noise) {
  const level = read();
  if (!level) return MOST;
  return noise === null ? 0 : Math.min(Number((mean * (noise / level) ** 2).toPrecision(1)), MOST);
}

/** @param {number} noise */
const percent = (noise) => `${Number((100 * noise).toPrecision(2))} %`;

/**
 * The selected level, which is remembered.
 *
 * @param {() => void} changed
 */
export function clarityField(changed) {
  const kept = read();
  const element = h(
    "select",
    { "aria-label": t("How clear the view becomes"), title: t("How clear the view becomes: it is rendered until it has this much noise") },
    LEVELS.map((level) => h("option", { value: level, selected: level === kept }, t("{how}, {noise} noise", { how: HOW[level] ?? "", noise: percent(level) }))),
    h("option", { value: 0, selected: kept === 0 }, t("256 samples")),
  );
  element.addEventListener("change", () => {
    try {
      localStorage.setItem(KEY, element.value);
    } catch {
      // Storage is blocked: the choice lasts until the page is closed.
    }
    changed();
  });
  return {
    element,
    /** The fields for a view's request. @returns {{noise?: number}} */
    request: () => (Number(element.value) ? { noise: Number(element.value) } : {}),
  };
}

function read() {
  try {
    const kept = localStorage.getItem(KEY);
    return kept !== null && [...LEVELS, 0].includes(Number(kept)) ? Number(kept) : DEFAULT;
  } catch {
    return DEFAULT;
  }
}
