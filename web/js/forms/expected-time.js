/** The expected time and noise of a picture, from one measurement of a scene on this farm, which is held. */

import { durationText } from "../base/format.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").Worker} Worker */

/** Seconds until the first samples, whatever the picture's size. */
const BEGIN_S = 0.5;
/** Above this relative noise no estimate is shown, since a few bright pixels may dominate it. */
const NO_PICTURE = 1;
/** Times that are shown, in seconds, up to ten days: each about half as long again as the one before. */
const RUNGS = /** @type {[number, number[]][]} */ ([[1, [1, 2, 3, 5, 7, 10, 15, 20, 30, 45]], [60, [1, 1.5, 2, 3, 5, 7, 10, 15, 20, 30, 45]], [3600, [1, 1.5, 2, 3, 5, 8, 12]], [86400, [1, 2, 3, 5, 10]]]).flatMap(([unit, counts]) => counts.map((n) => n * unit));
/** Factor by which a better measurement must differ to replace the one that is held. */
const APART = 1.5;
const KEY = "rayfarm-costs";
const MOST_SCENES = 100;

/** cost: seconds of a slot for a sample of a pixel. isFinal: measured by the scene's pictures, else by a view of it. @typedef {{cost: number, isFinal: boolean}} Measurement */

/** Number of the speeds of a view from which their mean is an estimate: single batches may be of the sky alone, or short. */
const ENOUGH = 3;
/** Sums of what workers have reported while they rendered a view, by scene. latest: the report that is included last. @type {Map<string, {cost: number, count: number, latest: Worker[]}>} */
const reports = new Map();

/** Returns the measurement to hold after another one. @param {Measurement | undefined} held @param {Measurement | null} next @returns {Measurement | undefined} */
function better(held, next) {
  if (!next || !held) return next ?? held;
  if (!next.isFinal && held.isFinal) return held;
  const ratio = next.cost / held.cost;
  return ratio > APART || ratio < 1 / APART ? next : { cost: held.cost, isFinal: next.isFinal };
}

/**
 * Returns the measurement by a scene's pictures, or else by the workers' mean speed while they render a view; null: there is none, as while
 * they compile. At other times the speeds are those of any scene.
 *
 * @param {Scene} scene
 * @param {Worker[]} workers
 * @returns {Measurement | null}
 */
function measurementOf(scene, workers) {
  if (scene.measured) return { cost: scene.measured.sample_s, isFinal: true };
  const doing = workers.flatMap(({ current }) => current ?? []);
  if (doing.some(({ compiling }) => compiling) || !doing.some(({ view }) => view !== undefined)) return null;
  const slots = workers.reduce((sum, { slots, samples_per_s: speed }) => sum + (speed > 0 ? slots : 0), 0);
  const speed = workers.reduce((sum, { slots, samples_per_s: speed }) => sum + slots * speed, 0);
  if (speed <= 0) return null;
  const all = reports.get(scene.id) ?? { cost: 0, count: 0, latest: [] };
  reports.set(scene.id, all);
  if (all.latest !== workers) {
    all.cost += slots / speed;
    all.count += 1;
    all.latest = workers;
  }
  return all.count < ENOUGH ? null : { cost: all.cost / all.count, isFinal: false };
}

/** The measurements that are held, by scene, also for the next time that the page is opened. @type {Map<string, Measurement>} */
const known = stored();

/** @returns {Map<string, Measurement>} */
function stored() {
  try {
    return new Map(JSON.parse(localStorage.getItem(KEY) ?? "[]"));
  } catch {
    return new Map(); // storage is blocked, or was written by another release
  }
}

/** Returns the seconds of a slot for a sample of a scene; null: unknown. @param {Scene} scene @param {Worker[]} workers */
function costOf(scene, workers) {
  const before = known.get(scene.id);
  const next = better(before, measurementOf(scene, workers));
  if (next && (next.cost !== before?.cost || next.isFinal !== before.isFinal)) {
    known.delete(scene.id); // the latest one last
    known.set(scene.id, next);
    try {
      localStorage.setItem(KEY, JSON.stringify([...known].slice(-MOST_SCENES)));
    } catch {
      // Storage is blocked: they are held until the page is closed.
    }
  }
  return next?.cost ?? null;
}

/**
 * Estimates a picture's time and noise.
 *
 * @param {Scene} scene
 * @param {Worker[]} workers
 * @param {number} pixels of all frames together
 * @param {number} spp
 * @returns {{seconds: number | null, noise: number | null}}
 */
export function expected(scene, workers, pixels, spp) {
  const cost = costOf(scene, workers);
  const slots = workers.reduce((sum, { slots }) => sum + slots, 0);
  const noise = scene.measured?.noise ? scene.measured.noise / Math.sqrt(spp) : Infinity;
  return { seconds: cost && slots ? BEGIN_S + (pixels * spp * cost) / slots : null, noise: noise < NO_PICTURE ? noise : null };
}

/** Returns an expected time in words, rounded: "15 s", "2 min". @param {number} seconds */
export function expectedText(seconds) {
  const away = (/** @type {number} */ rung) => Math.abs(Math.log(rung / Math.max(seconds, 1)));
  return durationText(RUNGS.reduce((best, rung) => (away(rung) < away(best) ? rung : best)));
}
