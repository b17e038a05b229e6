/** The up axis of files that state none, guessed as the service does (renderer/scene/readers/up_axis.py, which explains the rule). */

import { IDENTITY } from "./matrix.js";
import { boundsOf } from "./shapes.js";

/** @typedef {import("./shapes.js").Shape} Shape */

/** Matrices by which an axis becomes Y, column by column. */
const MATRICES = { y: IDENTITY, z: [1, 0, 0, 0, 0, 0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1], "-y": [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1] };

const LEVEL = 0.01;
const LEVEL_NORMAL = 0.95;
const STANDS = 0.3;
const HANGS = 0.1;
const GROUNDED = 0.05;

/** @typedef {"y" | "z"} Axis */

/** Returns the matrix that turns shapes to Y up. @param {Shape[]} shapes @param {Axis | "-y"} custom the format's conventional up axis; "-y": of 3D Gaussians, which have no bottom to guess by @returns {number[]} */
export const uprightMatrix = (shapes, custom) => MATRICES[custom === "-y" ? custom : guessUp(shapes, custom)];

/** @param {Shape[]} shapes @param {Axis} custom @returns {Axis} */
export function guessUp(shapes, custom) {
  const other = custom === "y" ? "z" : "y";
  const [a, b] = custom === "y" ? [2, 1] : [1, 2]; // the coordinates of the other and of the conventional axis
  const low = [Infinity, Infinity, Infinity];
  const high = [-Infinity, -Infinity, -Infinity];
  for (const { positions } of shapes) {
    const bounds = boundsOf(positions);
    for (let axis = 0; axis < 3; axis++) {
      low[axis] = Math.min(low[axis] ?? 0, bounds.low[axis] ?? 0);
      high[axis] = Math.max(high[axis] ?? 0, bounds.high[axis] ?? 0);
    }
  }
  const at = (/** @type {number[]} */ values, /** @type {number} */ axis) => values[axis] ?? 0;
  const extent = [0, 1, 2].map((axis) => at(high, axis) - at(low, axis));
  const isGrounded = Math.abs(at(low, a)) < GROUNDED * at(extent, a);
  const isThrough = at(low, b) < -GROUNDED * at(extent, b) && at(high, b) > GROUNDED * at(extent, b);
  if (!isGrounded || !isThrough || !extent.every((value) => value > 0)) return custom;
  const bottom = (/** @type {number} */ axis) =>
    shapes.reduce((sum, shape) => sum + levelArea(shape, axis, at(low, axis) + LEVEL * at(extent, axis)), 0) / ((at(extent, 0) * at(extent, 1) * at(extent, 2)) / at(extent, axis));
  return bottom(a) > STANDS && bottom(b) < HANGS ? other : custom;
}

/** Returns the area of a shape's horizontal triangles whose middle is below a limit. @param {Shape} shape @param {number} axis upward @param {number} limit */
function levelArea({ positions, indices }, axis, limit) {
  const [i, j] = [(axis + 1) % 3, (axis + 2) % 3];
  let area = 0;
  for (let k = 0; k < indices.length; k += 3) {
    const a = 3 * (indices[k] ?? 0);
    const b = 3 * (indices[k + 1] ?? 0);
    const c = 3 * (indices[k + 2] ?? 0);
    const height = positions[a + axis] ?? 0;
    const [u, v] = [(positions[b + axis] ?? 0) - height, (positions[c + axis] ?? 0) - height];
    if (height + (u + v) / 3 >= limit) continue;
    const [x, y] = [positions[a + i] ?? 0, positions[a + j] ?? 0];
    const [bx, by, cx, cy] = [(positions[b + i] ?? 0) - x, (positions[b + j] ?? 0) - y, (positions[c + i] ?? 0) - x, (positions[c + j] ?? 0) - y];
    const up = Math.abs(bx * cy - by * cx);
    if (up > LEVEL_NORMAL * Math.hypot(up, by * v - u * cy, u * cx - bx * v)) area += up / 2;
  }
  return area;
}
