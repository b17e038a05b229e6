/**
 * The remaining time of a job until its last picture: the service's forecast, smoothed and rounded. It is not shown in the first seconds, nor before a part
 * of the work is done: until then the forecast rests on the short batches of the first samples. A short job has none.
 */

import { roughly } from "../base/format.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/** Longest and shortest time constant of the smoothing; between them it is an eighth of the remaining time. */
const [SMOOTHING_S, LEAST_SMOOTHING_S] = [30, 1];
/** Part of its work that a job must have done, and that of a job that has taken LONG_S seconds. */
const [MIN_PROGRESS, MIN_PROGRESS_OF_LONG, LONG_S] = [0.2, 0.05, 20];
/** Rendering time, in seconds, before which no forecast is shown, and the expected time of a whole job below which none is. */
const [FIRST_S, SHORT_S] = [3, 10];
/** Time, in seconds, that a value stays before it rises, and the factor by which it then rises at most. */
const [HOLD_S, MOST_RISE] = [5, 1.25];
/** Time, in seconds, from which it is shown in minutes. */
const SECONDS = 120;
/** A forecast that is this many times as long shows a change of the farm, such as a worker that left, and is adopted. */
const CHANGED = 2;

/** Exponentially smoothed end of one job. */
export class SmoothedEnd {
  constructor() {
    /** Smoothed end, in seconds of the caller's clock. @type {number | null} */
    this.end = null;
    this.at = 0;
    /** Value that is shown, in seconds, and since when. @type {number | null} */
    this.shown = null;
    this.shownAt = 0;
  }

  /** @param {number} left forecast remaining seconds @param {number} now seconds */
  add(left, now) {
    const end = now + left;
    const smoothing = Math.max(Math.min(left / 8, SMOOTHING_S), LEAST_SMOOTHING_S);
    const weight = this.end === null ? 1 : 1 - Math.exp(-Math.max(now - this.at, 0) / smoothing);
    this.end = this.end === null ? end : this.end + weight * (end - this.end);
    this.at = now;
  }

  /** @param {number} now seconds @returns {number | null} remaining seconds; null without a forecast */
  left(now) {
    return this.end === null ? null : Math.max(this.end - now, 0);
  }

  /** @param {number} now seconds @returns {number | null} rounded remaining seconds, which seldom rise, and then by a quarter at most; null without a forecast */
  steady(now) {
    const left = this.left(now);
    if (left === null) return null;
    const next = rounded(left);
    if (this.shown !== null && next > this.shown) {
      const allowed = left >= CHANGED * this.shown ? next : rounded(Math.min(left, MOST_RISE * this.shown), Math.floor);
      if (now - this.shownAt < HOLD_S || allowed <= this.shown) return this.shown;
      this.shown = allowed;
      this.shownAt = now;
    } else if (next !== this.shown) {
      this.shown = next;
      this.shownAt = now;
    }
    return this.shown;
  }
}

/**
 * Rounds a remaining time to about a tenth of itself: 5 s, 10 s, a minute, 5 minutes, half an hour; 0 below 2.5 s.
 *
 * @param {number} seconds
 * @param {(steps: number) => number} [round]
 */
export function rounded(seconds, round = Math.round) {
  const step = /** @type {const} */ ([
    [60, 5],
    [SECONDS, 10],
    [20 * 60, 60],
    [90 * 60, 300],
    [Infinity, 1800],
  ]).find(([below]) => seconds < below)?.[1] ?? 1800;
  return round(seconds / step) * step;
}

/** Smoothed ends of running jobs, by job id. @type {Map<string, SmoothedEnd>} */
const ends = new Map();

/** Whether a job has done enough for a forecast, without what it took from an earlier one. @param {Job} job */
function isKnown({ progress, active_s: active, taken, spp }) {
  if (active < FIRST_S) return false;
  const begun = taken && spp ? Math.min(taken.spp / spp, 0.99) : 0;
  return (progress - begun) / (1 - begun) >= (active >= LONG_S ? MIN_PROGRESS_OF_LONG : MIN_PROGRESS);
}

/** Takes the forecast of a job's new description. @param {Job} job @param {number} [after] seconds from its last sample until its last picture @param {number} [now] seconds */
export function noteForecast(job, after = 0, now = performance.now() / 1000) {
  // While it does not progress, the forecast is that of the speed before.
  if (job.state !== "running" || job.eta_s == null || job.message || !isKnown(job)) {
    ends.delete(job.id);
    return;
  }
  if (!ends.has(job.id) && job.active_s + job.eta_s + after < SHORT_S) return;
  const end = ends.get(job.id) ?? new SmoothedEnd();
  ends.set(job.id, end);
  end.add(job.eta_s + after, now);
}

/** Returns a remaining time in words: "a few seconds", "about 5 s", "about 45 min". @param {number} seconds rounded */
export const leftText = (seconds) => (seconds <= 0 ? t("a few seconds") : seconds < SECONDS ? t("about {n} s", { n: seconds }) : roughly(seconds));

/** @param {string} id of a job @param {number} [now] seconds @returns {string} "about 45 min"; empty without a forecast */
export function timeLeft(id, now = performance.now() / 1000) {
  const left = ends.get(id)?.steady(now);
  return left == null ? "" : leftText(left);
}
