/**
 * The expected time and noise of a picture, from its start until its last, denoised picture: from what the farm has measured while it
 * rendered the scene. It changes once in a visit at most, when the first measurement comes.
 */

import { durationText } from "../base/format.js";
import { t } from "../base/words.js";
import { denoisingTime } from "../news/denoising-time.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").Worker} Worker */

/** Seconds until the first samples, whatever the picture's size. */
const BEGIN_S = 0.7;
/** Duration of a job relative to that of its batches, where no job of the scene was long enough to tell. */
const USUAL_PACE = 1.2;
/** Factor between the middle of a range and its ends: a view's cost differs by as much from that of its picture. */
const UNSURE = 1.4;
/** Above this relative noise no estimate is shown, since a few bright pixels may dominate it. */
const NO_PICTURE = 1;
/** Times that are shown, in seconds, up to ten days: each about half as long again as the one before. */
const RUNGS = /** @type {[number, number[]][]} */ ([[1, [1, 2, 3, 5, 7, 10, 15, 20, 30, 45]], [60, [1, 1.5, 2, 3, 5, 7, 10, 15, 20, 30, 45]], [3600, [1, 1.5, 2, 3, 5, 8, 12]], [86400, [1, 2, 3, 5, 10]]]).flatMap(([unit, counts]) => counts.map((n) => n * unit));

/** cost: seconds of a slot for a sample of a pixel. pace: of its jobs. isSure: measured by the scene's pictures, else by a view of it. @typedef {{cost: number, pace: number, isSure: boolean}} Measurement */

/** isSure: whether it is as exact as the words "About" promise. @typedef {{seconds: number | null, isSure: boolean, noise: number | null}} Expectation */

/** The measurement that a visit of a scene's page holds. */
export class HeldMeasurement {
  constructor() {
    /** @type {Measurement | null} */
    this.held = null;
    /** By the scene's live view, in seconds of a slot for a sample. @type {number | null} */
    this.ofView = null;
  }

  /** Returns what is held; the first measurement stays. @param {Scene} scene @returns {Measurement | null} */
  of({ measured }) {
    if (measured) this.held ??= { cost: measured.sample_s, pace: measured.pace ?? USUAL_PACE, isSure: true };
    else if (this.ofView) this.held ??= { cost: this.ofView, pace: USUAL_PACE, isSure: false };
    return this.held;
  }
}

/** @param {Worker[]} workers */
const slotsOf = (workers) => workers.reduce((sum, { slots }) => sum + slots, 0);

/**
 * Estimates a picture's time and noise.
 *
 * @param {Scene} scene
 * @param {HeldMeasurement} measurement of the present visit
 * @param {Scene[]} others
 * @param {Worker[]} workers
 * @param {{pixels: number, spp: number, isDenoised: boolean}} picture pixels: of all frames together
 * @returns {Expectation}
 */
export function expected(scene, measurement, others, workers, { pixels, spp, isDenoised }) {
  const known = measurement.of(scene);
  const slots = slotsOf(workers);
  const noise = scene.measured?.noise ? scene.measured.noise / Math.sqrt(spp) : Infinity;
  const seconds = known && slots ? BEGIN_S + (pixels * spp * known.cost * known.pace) / slots + (isDenoised ? denoisingTime(scene, others, workers, pixels) : 0) : null;
  return { seconds, isSure: known?.isSure ?? false, noise: noise < NO_PICTURE ? noise : null };
}

/** @param {number} seconds */
function rung(seconds) {
  const away = (/** @type {number} */ rung) => Math.abs(Math.log(rung / Math.max(seconds, 1)));
  return RUNGS.reduce((best, rung) => (away(rung) < away(best) ? rung : best));
}

/** Returns an expected time in words, rounded: "15 s", "2 min". @param {number} seconds */
export const expectedText = (seconds) => durationText(rung(seconds));

/** Returns the range of an expected time that is not sure, in words: "10 to 20 s". @param {number} seconds */
export function rangeText(seconds) {
  const [low, high] = [rung(seconds / UNSURE), rung(seconds * UNSURE)];
  if (low === high) return durationText(low); // a second or less, or ten days or more
  return high < 60 ? t("{low} to {high} s", { low, high }) : t("{low} to {high}", { low: durationText(low), high: durationText(high) });
}
