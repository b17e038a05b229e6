/** Presets of size and quality, and the cost of a request. */

import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Worker} Worker */

export const SIZES = [
  { name: "small", label: t("Small"), long: 960 },
  { name: "hd", label: "HD", long: 1280 },
  { name: "full-hd", label: "Full HD", long: 1920 },
  { name: "4k", label: "4k", long: 3840 },
];

/** Each halves the noise of the one before. */
export const QUALITIES = [
  { name: "draft", label: t("Draft"), spp: 16 },
  { name: "good", label: t("Good"), spp: 64 },
  { name: "final", label: t("Final"), spp: 256 },
  { name: "finest", label: t("Finest"), spp: 1024 },
];

/** The option beside the presets. */
export const CUSTOM = "custom";

/**
 * @param {number} long the longer side, in pixels
 * @param {number} aspect width / height
 */
export function sizeOf(long, aspect) {
  return aspect >= 1
    ? { width: long, height: Math.max(1, Math.round(long / aspect)) }
    : { width: Math.max(1, Math.round(long * aspect)), height: long };
}

/** Seconds until the first samples, whatever the picture's size. */
const BEGIN_S = 0.5;

/** Above this relative noise no estimate is shown, since a few bright pixels may dominate it. */
const NO_PICTURE = 1;

/** Time, in milliseconds, over which the speeds of workers are averaged: busy machines change theirs by the second. */
const STEADY_MS = 30_000;

/** Ends of the ranges of expected times, in seconds, up to ten days. */
const RUNGS = /** @type {[number, number[]][]} */ ([[1, [1, 2, 3, 5, 8, 10, 15, 20, 30, 45]], [60, [1, 2, 3, 4, 5, 8, 10, 15, 20, 30, 45]], [3600, [1, 2, 3, 5, 8, 12]], [86400, [1, 2, 3, 5, 10]]]).flatMap(([unit, counts]) => counts.map((n) => n * unit));

/** How much faster or slower than expected a picture may become: machines also have other work. */
const [FASTER, SLOWER] = [0.8, 1.6];

/**
 * Returns a function that returns the range of a time, and returns the same range as long as the times are well inside it.
 *
 * @returns {(key: string, seconds: number) => [number, number]} key: what is estimated
 */
export function steadyRanges() {
  /** @type {Map<string, [number, number]>} */
  const known = new Map();
  return (key, seconds) => {
    const before = known.get(key);
    if (before && before[0] <= seconds && seconds <= before[1]) return before;
    const low = RUNGS.findLast((rung) => rung <= FASTER * seconds) ?? 0;
    const high = RUNGS.find((rung) => rung >= SLOWER * seconds) ?? SLOWER * seconds;
    const range = /** @type {[number, number]} */ ([low, high]);
    known.set(key, range);
    return range;
  };
}

/** @returns {(workers: Worker[]) => Worker[]} the workers with speeds averaged since the first call */
export function steadySpeeds() {
  /** @type {Map<string, {speed: number, at: number}>} */
  const known = new Map();
  return (workers) =>
    workers.map((worker) => {
      const now = performance.now();
      const before = known.get(worker.name);
      const share = before?.speed ? 1 - Math.exp((before.at - now) / STEADY_MS) : 1;
      const speed = (before?.speed ?? 0) + share * (worker.samples_per_s - (before?.speed ?? 0));
      known.set(worker.name, { speed, at: now });
      return { ...worker, samples_per_s: speed };
    });
}

/**
 * Estimates a picture's time and noise: from measurements of the scene's latest picture, or else the time alone from the
 * workers' latest speeds.
 *
 * @param {import("../base/types.js").Scene | undefined} scene
 * @param {Worker[]} workers
 * @param {number} pixels of all frames together
 * @param {number} spp
 * @returns {{seconds: number | null, noise: number | null}}
 */
export function expected(scene, workers, pixels, spp) {
  const samples = pixels * spp;
  const measured = scene?.measured;
  const slots = workers.reduce((sum, { slots }) => sum + slots, 0);
  const others = workers.reduce((sum, { slots, samples_per_s }) => sum + slots * samples_per_s, 0);
  const noise = measured?.noise ? measured.noise / Math.sqrt(spp) : Infinity;
  const speed = measured ? slots / measured.sample_s : others;
  return {
    seconds: speed > 0 ? BEGIN_S + samples / speed : null,
    noise: noise < NO_PICTURE ? noise : null,
  };
}
