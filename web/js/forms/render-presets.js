/** Sizes and qualities that people ask for, and what a request costs. */

/** @typedef {import("../base/types.js").Worker} Worker */
/** @typedef {import("../base/types.js").Job} Job */

export const SIZES = [
  { name: "preview", label: "Preview", long: 640 },
  { name: "hd", label: "HD", long: 1280 },
  { name: "full-hd", label: "Full HD", long: 1920 },
  { name: "4k", label: "4k", long: 3840 },
];

export const QUALITIES = [
  { name: "draft", label: "Draft", spp: 16 },
  { name: "good", label: "Good", spp: 128 },
  { name: "final", label: "Final", spp: 512 },
];

/** The choice beside the presets. */
export const CUSTOM = "custom";

export const DEFAULT_ASPECT = 16 / 9;

/**
 * @param {number} long the longer side, in pixels
 * @param {number} aspect width / height
 */
export function sizeOf(long, aspect) {
  return aspect >= 1
    ? { width: long, height: Math.max(1, Math.round(long / aspect)) }
    : { width: Math.max(1, Math.round(long * aspect)), height: long };
}

/**
 * Samples per second that the farm can be expected to reach: what the scene's own latest job measured, else what the
 * workers measured on whatever they rendered last; 0 where neither is known.
 *
 * @param {Worker[]} workers
 * @param {Job[]} jobs newest first
 * @param {string} scene
 */
export function expectedSpeed(workers, jobs, scene) {
  const own = jobs.find((job) => job.scene === scene && job.active_s > 1);
  if (own) return own.samples / own.active_s;
  return workers.reduce((sum, worker) => sum + worker.slots * worker.samples_per_s, 0);
}
