/** What a shot is, and how far it is, in a few words. */

import { count, plural } from "./format.js";

/** @typedef {import("./types.js").Job} Job */

const LONGEST = 24;

/** Whether a job has more than one picture. @param {Job} job */
export const isShot = (job) => (job.shot?.count ?? 1) > 1;

/** The frame that stands for a job: a still's only one. @param {Job} job */
export const firstFrame = (job) => job.frames?.[0]?.number ?? 0;

/**
 * "frames 0-99 at 24 fps", and of a still of a later moment "frame 12"; empty for any other.
 *
 * @param {Job} job
 * @param {number | null} [fps] the scene's own
 */
export function shotName({ shot }, fps = null) {
  if (!shot) return "";
  const speed = shot.fps ?? fps;
  const which = shot.frames.length > LONGEST ? `${count(shot.count)} frames` : `frames ${shot.frames}`;
  return shot.count === 1 ? `frame ${shot.frames}` : `${which}${speed ? ` at ${speed} fps` : ""}`;
}

/** "37 of 100 frames". @param {NonNullable<Job["shot"]>} shot */
export function framesDone({ states, count: all, failed }) {
  const holes = failed ? `, ${count(states.failed ?? 0)} failed` : "";
  return `${count(states.finished ?? 0)} of ${plural(all, "frame")}${holes}`;
}
