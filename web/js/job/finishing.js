/** The end of a job: from its last sample until its last denoised picture is shown, its state is "finishing", with progress. */

import { t } from "../base/words.js";

/** Fraction of the progress that is reached by the expected time; the rest is left for a picture that takes longer. */
const AT_EXPECTED = 0.9;

/** Seconds after its end until which a job whose page is opened may be finishing. */
const RECENT_S = 60;

/** Whether a job has ended so long ago that its page shows it as finished, also while its picture is denoised. @param {Pick<import("../base/types.js").Job, "state" | "finished">} job @param {number} [now] seconds since 1970 */
export const endedBefore = ({ state, finished }, now = Date.now() / 1000) => state === "finished" && now - (finished ?? 0) > RECENT_S;

/** The time since a job began to finish. */
export class Finishing {
  constructor() {
    /** Time, in seconds, at which it began; null: it is not finishing. @type {number | null} */
    this.since = null;
    this.expected = 0;
  }

  /**
   * Takes the job's state.
   *
   * @param {boolean} is whether the last denoised picture is still to come
   * @param {number} expected seconds that it takes
   * @param {number} [now] seconds
   */
  update(is, expected, now = performance.now() / 1000) {
    if (!is) this.since = null;
    else if (this.since === null) [this.since, this.expected] = [now, expected];
  }

  /** @param {number} [now] seconds @returns {number | null} seconds until the picture is expected, at least one; null: the job is not finishing */
  left(now = performance.now() / 1000) {
    return this.since === null ? null : Math.max(this.expected - (now - this.since), 1);
  }

  /** Returns the progress, from 0 to 1; it slows down at the expected time. @param {number} [now] seconds */
  progress(now = performance.now() / 1000) {
    if (this.since === null) return 0;
    const part = (now - this.since) / Math.max(this.expected, 0.1);
    return part <= 1 ? AT_EXPECTED * part : 1 - (1 - AT_EXPECTED) / part;
  }
}

/**
 * Returns the progress of a job until its last denoised picture, from 0 to 1. Increases with every argument except `denoising`.
 *
 * @param {number} rendered progress of its samples
 * @param {number} active seconds for which it has been rendered
 * @param {number} denoising seconds that its last denoised picture takes
 * @param {number} denoised progress of that picture
 */
export function wholeProgress(rendered, active, denoising, denoised) {
  if (rendered < 1) return rendered ? (rendered * active) / (active + rendered * denoising) : 0; // active / rendered: its expected time
  return (active + denoised * denoising) / Math.max(active + denoising, 0.1);
}

/** @param {number} seconds @returns {string} "about 5 s more" */
export const secondsText = (seconds) => (seconds > 1 ? t("about {n} s more", { n: Math.ceil(seconds) }) : t("a moment more"));
