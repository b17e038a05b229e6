/** What stands on a wide, flat floor, as the service's automatic camera frames it (renderer/scene/standing.py, which explains the rule). */

import { placed } from "./room.js";

/** @typedef {import("./shapes.js").Drawn} Drawn */

const [FLAT, SUNK, WIDER, LONGER, MARGIN] = [0.02, 0.05, 4, 1.2, 1e-5];
const [X, UP, Z] = [0, 1, 2];

/** @typedef {{low: number[], high: number[]}} Box */

/** Returns the bounding box of boxes, of which a scene may have hundreds of thousands. @param {Iterable<Box>} boxes @returns {Box} */
function union(boxes) {
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (const box of boxes)
    for (const axis of [X, UP, Z]) {
      low[axis] = Math.min(low[axis] ?? 0, box.low[axis] ?? 0);
      high[axis] = Math.max(high[axis] ?? 0, box.high[axis] ?? 0);
    }
  return { low, high };
}

/** @param {Box} box @param {number} axis */
const side = ({ low, high }, axis) => (high[axis] ?? 0) - (low[axis] ?? 0);

/** @param {Drawn} drawn @returns {Box} */
function boxOf({ shape, matrix }) {
  const places = placed(shape.positions, matrix);
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  places.forEach((value, k) => {
    const axis = k % 3;
    low[axis] = Math.min(low[axis] ?? 0, value);
    high[axis] = Math.max(high[axis] ?? 0, value);
  });
  return { low, high };
}

/**
 * Returns the places that the automatic camera frames: all, or those within the footprint of what stands on a floor.
 *
 * @param {Drawn[]} drawn
 * @param {Float64Array} places of all vertices
 */
export function framedPlaces(drawn, places) {
  const boxes = drawn.filter(({ shape }) => shape.positions.length > 0).map(boxOf);
  const isFlat = (/** @type {Box} */ box) => side(box, UP) <= FLAT * Math.min(side(box, X), side(box, Z));
  const things = boxes.filter((box) => !isFlat(box));
  if (!things.length || things.length === boxes.length) return places;
  const raised = union(things);
  const floors = new Set(boxes.filter((box) => isFlat(box) && (box.high[UP] ?? 0) <= (raised.low[UP] ?? 0) + SUNK * side(raised, UP)));
  if (!floors.size) return places;
  const [floor, standing] = [union(floors), union(boxes.filter((box) => !floors.has(box)))];
  const isWide = [X, Z].every((axis) => side(floor, axis) >= LONGER * side(standing, axis));
  const isLong = Math.max(side(floor, X), side(floor, Z)) >= LONGER * Math.max(...[X, UP, Z].map((axis) => side(standing, axis)));
  if (!isWide || !isLong || side(floor, X) * side(floor, Z) < WIDER * side(standing, X) * side(standing, Z)) return places;
  const margin = MARGIN * Math.max(...[X, UP, Z].map((axis) => side(standing, axis)));
  const isWithin = (/** @type {number} */ value, /** @type {number} */ axis) => value >= (standing.low[axis] ?? 0) - margin && value <= (standing.high[axis] ?? 0) + margin;
  const kept = [];
  for (let k = 0; k < places.length; k += 3)
    if (isWithin(places[k + X] ?? 0, X) && isWithin(places[k + Z] ?? 0, Z)) kept.push(places[k] ?? 0, places[k + 1] ?? 0, places[k + 2] ?? 0);
  return kept.length ? Float64Array.from(kept) : places;
}
