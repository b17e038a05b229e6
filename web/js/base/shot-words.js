/** Short descriptions of a shot and its progress. */

import { count } from "./format.js";
import { t, tn } from "./words.js";

/** @typedef {import("./types.js").Job} Job */

const LONGEST = 24;

/** Whether a job has more than one frame. @param {Job} job */
export const isShot = (job) => (job.shot?.count ?? 1) > 1;

/** The number of the frame that represents a job: the only one of a still. @param {Job} job */
export const firstFrame = (job) => job.frames?.[0]?.number ?? 0;

/**
 * "frames 0-99 at 24 fps", or "frame 12" for a still at a later time; empty otherwise.
 *
 * @param {Job} job
 * @param {number | null} [fps] the scene's own
 */
export function shotName({ shot }, fps = null) {
  if (!shot) return "";
  const speed = shot.fps ?? fps;
  const which = shot.frames.length > LONGEST ? tn(shot.count, "{n} frame", "{n} frames") : t("frames {frames}", { frames: shot.frames });
  return shot.count === 1 ? t("frame {number}", { number: shot.frames }) : `${which}${speed ? t(" at {speed} fps", { speed }) : ""}`;
}

/** "37 of 100 frames". @param {NonNullable<Job["shot"]>} shot */
export function framesDone({ states, count: all, failed }) {
  const holes = failed ? t(", {failed} failed", { failed: count(states.failed ?? 0) }) : "";
  return tn(all, "{done} of {n} frame", "{done} of {n} frames", { done: count(states.finished ?? 0) }) + holes;
}
