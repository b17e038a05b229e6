/** Outlines of the tiles being rendered, with worker and slot where there are several workers, in the worker's colour. */

import { workerColours } from "./worker-colours.js";

/** @typedef {import("../base/types.js").Worker} Worker */
/** @typedef {import("./pixel-overlay.js").Outline} Outline */

/**
 * @param {Worker[]} workers
 * @param {{job: string, frame: number}} place
 * @returns {Outline[]}
 */
export function outlinesOf(workers, { job, frame }) {
  const colours = workerColours(workers);
  return workers.flatMap(({ name, current }) =>
    current.flatMap((slot, i) => {
      if (slot.job !== job || (slot.frame ?? frame) !== frame || !slot.tile) return [];
      const [x, y, w, h] = slot.tile;
      return [{ x, y, w, h, ...(workers.length > 1 ? { label: `${name} · ${i + 1}`, short: String(i + 1) } : { label: "", short: "" }), worker: name, colour: colours.get(name) ?? "#fff" }];
    }),
  );
}
