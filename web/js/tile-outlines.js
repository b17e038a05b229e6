/** Which tiles of a job the workers render at this moment, as outlines with their worker's name. */

/** @typedef {import("./types.js").Worker} Worker */
/** @typedef {import("./pixel-overlay.js").Outline} Outline */

/**
 * @param {Worker[]} workers
 * @param {string} job
 * @returns {Outline[]}
 */
export function outlinesOf(workers, job) {
  return workers.flatMap(({ name, current }) =>
    current.flatMap((slot) => {
      if (slot.job !== job || !slot.tile) return [];
      const [x, y, w, h] = slot.tile;
      return [{ x, y, w, h, label: name }];
    }),
  );
}
