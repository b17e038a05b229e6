/** Which tiles of a picture the workers render at this moment, as outlines with their worker's name. */

/** @typedef {import("../base/types.js").Worker} Worker */
/** @typedef {import("./pixel-overlay.js").Outline} Outline */

/**
 * @param {Worker[]} workers
 * @param {{job: string, frame: number}} place
 * @returns {Outline[]}
 */
export function outlinesOf(workers, { job, frame }) {
  return workers.flatMap(({ name, current }) =>
    current.flatMap((slot) => {
      if (slot.job !== job || (slot.frame ?? frame) !== frame || !slot.tile) return [];
      const [x, y, w, h] = slot.tile;
      return [{ x, y, w, h, label: name }];
    }),
  );
}
