/** Outlines of the tiles being rendered, with worker, if there are several, and slot, in the worker's colour. */

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
      return [{ x, y, w, h, label: workers.length > 1 ? `${name} · ${i + 1}` : String(i + 1), short: String(i + 1), worker: name, colour: colours.get(name) ?? "#fff" }];
    }),
  );
}
