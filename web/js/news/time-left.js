/**
 * The remaining time of a job: the service's forecast, smoothed and rounded. A forecast follows the speed of the last batches and
 * swings by a factor of three; a forecast from less than 5 % of the work is not shown.
 */

import { roughly } from "../base/format.js";

/** @typedef {import("../base/types.js").Job} Job */

/** Longest and shortest time constant of the smoothing; between them it is half of the remaining time. */
const [SMOOTHING_S, LEAST_SMOOTHING_S] = [30, 2];
const MIN_PROGRESS = 0.05;

/** Exponentially smoothed end of one job. */
export class SmoothedEnd {
  constructor() {
    /** Smoothed end, in seconds of the caller's clock. @type {number | null} */
    this.end = null;
    this.at = 0;
  }

  /** @param {number} left forecast remaining seconds @param {number} now seconds */
  add(left, now) {
    const end = now + left;
    const smoothing = Math.max(Math.min(left / 2, SMOOTHING_S), LEAST_SMOOTHING_S);
    const weight = this.end === null ? 1 : 1 - Math.exp(-Math.max(now - this.at, 0) / smoothing);
    this.end = this.end === null ? end : this.end + weight * (end - this.end);
    this.at = now;
  }

  /** @param {number} now seconds @returns {number | null} remaining seconds; null without a forecast */
  left(now) {
    return this.end === null ? null : Math.max(this.end - now, 0);
  }
}

/**
 * Rounds a remaining time to about a tenth of itself: 5 s, 10 s, a minute, 5 minutes, half an hour.
 *
 * @param {number} seconds
 */
export function rounded(seconds) {
  const step = /** @type {const} */ ([
    [60, 5],
    [90, 10],
    [20 * 60, 60],
    [90 * 60, 300],
    [Infinity, 1800],
  ]).find(([below]) => seconds < below)?.[1] ?? 1800;
  return Math.max(Math.round(seconds / step) * step, step);
}

/** Smoothed ends of running jobs, by job id. @type {Map<string, SmoothedEnd>} */
const ends = new Map();

/** Takes the forecast of a job's new description. @param {Job} job @param {number} [now] seconds */
export function noteForecast(job, now = performance.now() / 1000) {
  // While it does not progress, the forecast is that of the speed before.
  if (job.state !== "running" || job.eta_s == null || job.message || job.progress < MIN_PROGRESS) {
    ends.delete(job.id);
    return;
  }
  const end = ends.get(job.id) ?? new SmoothedEnd();
  ends.set(job.id, end);
  end.add(job.eta_s, now);
}

/** @param {string} id of a job @param {number} [now] seconds @returns {string} "about 45 min"; empty without a forecast */
export function timeLeft(id, now = performance.now() / 1000) {
  const left = ends.get(id)?.left(now);
  return left == null ? "" : roughly(rounded(left));
}
