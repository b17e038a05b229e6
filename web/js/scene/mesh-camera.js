/** The matrix by which the preview mesh is drawn as the path tracer's camera sees it. */

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */

/** Field of view in place of a panorama, which no matrix projects. */
const PANORAMA_FOV = 90;
/** Nearest clipping plane, in sizes of the scene; and where more than the scene is drawn, by the distance of its middle. */
const [NEAREST, NEAR_SHARE] = [1e-3, 0.05];

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @param {Vec3} a @param {Vec3} b */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {Vec3} a @returns {Vec3} */
function unit(a) {
  const size = Math.hypot(...a) || 1;
  return [a[0] / size, a[1] / size, a[2] / size];
}

/**
 * Returns the axes of a camera: right, up in the picture, and backward.
 *
 * @param {View} view
 * @returns {[Vec3, Vec3, Vec3]}
 */
export function cameraAxes({ eye, target, up }) {
  const forward = unit(subtract(target, eye));
  const right = unit(cross(forward, up));
  return [right, cross(right, forward), [-forward[0], -forward[1], -forward[2]]];
}

/**
 * Returns the matrix from coordinates relative to the middle of the bounds to clip space, column by column. Relative, because
 * the graphics card has single precision and scenes may be far from the origin.
 *
 * @param {View} view
 * @param {number} aspect width of the picture by its height
 * @param {Vec3} low lower corner of the bounds
 * @param {Vec3} high
 * @param {number} [reach] how far from the middle of the bounds anything is drawn, in radii of the bounds
 * @returns {Float32Array<ArrayBuffer>} 16
 */
export function clipMatrix(view, aspect, low, high, reach = 1) {
  const middle = /** @type {Vec3} */ (low.map((value, i) => (value + (high[i] ?? 0)) / 2));
  const radius = Math.hypot(...subtract(high, low)) / 2 || 1;
  const axes = cameraAxes(view);
  const eye = subtract(view.eye, middle);
  const away = dot(axes[2], eye); // distance of the middle along the line of sight
  const far = Math.max(away + reach * radius, radius * NEAREST * 2) * 1.01;
  const isFlat = view.projection === "orthographic";
  let near = isFlat ? away - reach * radius * 1.01 : Math.max(away - radius * 1.01, radius * NEAREST, view.near ?? 0);
  if (reach > 1 && !isFlat) near = Math.max(Math.min(near, NEAR_SHARE * away), radius * NEAREST, view.near ?? 0);
  const [shiftX, shiftY] = [(2 * (view.shift_x ?? 0)) / aspect, 2 * (view.shift_y ?? 0)];
  const fov = view.projection === "panorama" ? PANORAMA_FOV : view.fov;
  // Half the visible height, at distance 1 or at any distance.
  const half = isFlat ? (view.height ?? 2) / 2 : Math.tan((fov * Math.PI) / 360);
  /** Rows of the projection of camera coordinates. @type {number[][]} */
  const rows = isFlat
    ? [
        [1 / (half * aspect), 0, 0, -shiftX],
        [0, 1 / half, 0, -shiftY],
        [0, 0, -2 / (far - near), -(far + near) / (far - near)],
        [0, 0, 0, 1],
      ]
    : [
        [1 / (half * aspect), 0, shiftX, 0],
        [0, 1 / half, shiftY, 0],
        [0, 0, -(far + near) / (far - near), (-2 * far * near) / (far - near)],
        [0, 0, -1, 0],
      ];
  const toCamera = [...axes.map((axis) => [...axis, -dot(axis, eye)]), [0, 0, 0, 1]];
  const matrix = new Float32Array(16);
  for (let row = 0; row < 4; row++)
    for (let column = 0; column < 4; column++)
      matrix[4 * column + row] = toCamera.reduce((sum, from, i) => sum + (rows[row]?.[i] ?? 0) * (from[column] ?? 0), 0);
  return matrix;
}
