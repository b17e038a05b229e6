/** Whether a camera can see anything of a scene, by its bounds alone. */

import { clipMatrix } from "./mesh-camera.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */

/**
 * Returns whether some of a box may be in a camera's picture; false is certain.
 *
 * @param {View} view
 * @param {number} aspect width of the picture by its height
 * @param {Vec3} low lower corner of the box
 * @param {Vec3} high
 */
export function mayBeInView(view, aspect, low, high) {
  if (view.projection === "panorama") return true;
  const matrix = clipMatrix(view, aspect, low, high);
  const half = low.map((value, i) => ((high[i] ?? 0) - value) / 2);
  const corners = Array.from({ length: 8 }, (_, n) => {
    const corner = [...half.map((size, i) => (n & (1 << i) ? size : -size)), 1]; // relative to the middle, as the matrix has it
    const [x = 0, y = 0, , w = 0] = [0, 1, 2, 3].map((row) => corner.reduce((sum, value, column) => sum + value * (matrix[4 * column + row] ?? 0), 0));
    return { x, y, w };
  });
  /** Half-spaces outside the pyramid of view: beside, above, below and behind it. @type {((corner: {x: number, y: number, w: number}) => boolean)[]} */
  const outside = [({ x, w }) => x > w, ({ x, w }) => x < -w, ({ y, w }) => y > w, ({ y, w }) => y < -w, ({ w }) => w <= 0];
  return !outside.some((is) => corners.every(is));
}
