/** The noise of the live view, and its target noise, measured as a job's. */

import { h } from "../base/dom.js";
import { t, tn } from "../base/words.js";

/** State of a view before its first picture. */
export const PREPARING = t("Preparing the view …");
/** Relative noise levels; the second is the default. */
const LEVELS = [0.05, 0.02, 0.01];
const DEFAULT = 0.02;
const MOST = 256; // samples a pixel of a view
const KEY = "rayfarm-view-noise";

/**
 * @param {number} mean samples a pixel so far
 * @param {number | null} noise relative; null: unknown with so few samples
 * @param {boolean} isDone
 * @param {boolean} [isPreview] whether the preview mesh or an earlier picture is shown in its place
 * @param {number} [denoised] samples a pixel of the denoised picture that is shown; 0: the noise is seen
 */
export function clarity(mean, noise, isDone, isPreview = false, denoised = 0) {
  if (isPreview) return isDone ? t("Preview") : t("Preview, rendering …");
  if (!mean) return t("Waiting for the first samples …");
  const shown = denoised || mean;
  const n = shown < 1 ? Number(shown.toPrecision(1)) : Math.round(shown);
  const all = isDone ? 0 : samplesFor(mean, noise);
  const samples = all > n ? t("{n} of about {all} samples", { n, all }) : tn(n, "{n} sample", "{n} samples");
  const left = denoised ? t("denoised") : noise === null ? "" : t("{noise} noise", { noise: percent(noise) });
  return [samples, left, isDone && t("done")].filter(Boolean).join(", ");
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
    { "aria-label": t("How clear the view becomes"), title: t("How clear the view becomes") },
    LEVELS.map((level) => h("option", { value: level, selected: level === kept }, t("To {noise} noise", { noise: percent(level) }))),
    h("option", { value: 0, selected: kept === 0 }, t("To 256 samples")),
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
