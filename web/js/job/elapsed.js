/** The elapsed time of a job, which continues between its descriptions and does not go back while the job goes on. */

/** @typedef {Pick<import("../base/types.js").Job, "state" | "active_s" | "elapsed_s">} Timed */

export class Elapsed {
  constructor() {
    /** @type {Timed | null} */
    this.job = null;
    this.heardAt = 0;
    this.shown = 0;
  }

  /** Takes a description. @param {Timed} job @param {number} [now] seconds */
  update(job, now = performance.now() / 1000) {
    if (this.job?.state === "finished" && job.state !== "finished") this.shown = 0; // it gets more samples
    this.job = { ...job };
    this.heardAt = now;
  }

  /** Returns the time in seconds. @param {boolean} isFinishing whether the last denoised picture is still to come @param {number} [now] seconds */
  seconds(isFinishing, now = performance.now() / 1000) {
    if (!this.job) return 0;
    const { state, active_s: active, elapsed_s: elapsed } = this.job;
    const runs = state === "running" || isFinishing;
    // A description is up to half a second old when it arrives, and the denoised picture arrives before that with its time.
    const isFinal = !runs && (state !== "finished" || elapsed > active);
    this.shown = isFinal ? elapsed : Math.max(this.shown, elapsed + (runs ? now - this.heardAt : 0));
    return this.shown;
  }
}
