/** How much of a scene a camera sees, by the scene's bounds alone. */

import { clipMatrix } from "./mesh-camera.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */

/** A corner of a box in clip space. @typedef {{x: number, y: number, w: number}} Corner */

/** @param {View} view @param {number} aspect @param {Vec3} low @param {Vec3} high @returns {Corner[]} */
function cornersInView(view, aspect, low, high) {
  const matrix = clipMatrix(view, aspect, low, high);
  const half = low.map((value, i) => ((high[i] ?? 0) - value) / 2);
  return Array.from({ length: 8 }, (_, n) => {
    const corner = [...half.map((size, i) => (n & (1 << i) ? size : -size)), 1]; // relative to the middle, as the matrix has it
    const [x = 0, y = 0, , w = 0] = [0, 1, 2, 3].map((row) => corner.reduce((sum, value, column) => sum + value * (matrix[4 * column + row] ?? 0), 0));
    return { x, y, w };
  });
}

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
  const corners = cornersInView(view, aspect, low, high);
  /** Half-spaces outside the pyramid of view: beside, above, below and behind it. @type {((corner: Corner) => boolean)[]} */
  const outside = [({ x, w }) => x > w, ({ x, w }) => x < -w, ({ y, w }) => y > w, ({ y, w }) => y < -w, ({ w }) => w <= 0];
  return !outside.some((is) => corners.every(is));
}

/**
 * Returns the share of a camera's picture that a box's outline covers, 0 to 1, including what lies beside the picture; 1 where the
 * camera is in the box or has no edges.
 *
 * @param {View} view
 * @param {number} aspect width of the picture by its height
 * @param {Vec3} low lower corner of the box
 * @param {Vec3} high
 */
export function shareInView(view, aspect, low, high) {
  const corners = cornersInView(view, aspect, low, high);
  if (view.projection === "panorama" || corners.some(({ w }) => w <= 0)) return 1;
  const points = corners.map(({ x, y, w }) => /** @type {[number, number]} */ ([x / w, y / w]));
  return Math.min(1, hullArea(points) / 4);
}

/** Returns the area of the convex hull of points (Andrew's monotone chain). @param {[number, number][]} points */
function hullArea(points) {
  const sorted = points.toSorted((a, b) => a[0] - b[0] || a[1] - b[1]);
  const half = (/** @type {[number, number][]} */ all) => {
    /** @type {[number, number][]} */
    const chain = [];
    for (const [x, y] of all) {
      for (;;) {
        const [a, b] = chain.slice(-2);
        if (!a || !b || (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) > 0) break;
        chain.pop();
      }
      chain.push([x, y]);
    }
    return chain.slice(0, -1);
  };
  const hull = [...half(sorted), ...half(sorted.toReversed())];
  return hull.reduce((sum, [x, y], i) => sum + (x * (hull[(i + 1) % hull.length]?.[1] ?? 0) - y * (hull[(i + 1) % hull.length]?.[0] ?? 0)) / 2, 0);
}
