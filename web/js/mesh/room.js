/** The camera of a room, which is inside, as the service's automatic camera (renderer/scene/room_camera.py, which explains the rule). */

/** @typedef {import("./shapes.js").Drawn} Drawn */
/** @typedef {import("./shapes.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").View} View */

const FOV = 60;
const BAND = 0.02;
const [COVERED, WALLS] = [0.5, 3];
const [OUT, EYE, TARGET] = [0.4, 0.1, -0.15];
const CLEAR = 0.12;
const CORNERS = /** @type {const} */ ([[1, 1], [-1, 1], [1, -1], [-1, -1]]);

/**
 * @param {Drawn[]} drawn
 * @param {Vec3} low lower corner of the scene
 * @param {Vec3} high
 * @returns {View | null} null if the scene is no room
 */
export function roomView(drawn, low, high) {
  const extent = /** @type {Vec3} */ (low.map((value, axis) => (high[axis] ?? 0) - value));
  if (!extent.every((value) => value > 0)) return null;
  const middle = /** @type {Vec3} */ (low.map((value, axis) => value + (extent[axis] ?? 0) / 2));
  const at = (/** @type {number} */ x, /** @type {number} */ y, /** @type {number} */ z) => /** @type {Vec3} */ ([middle[0] + x * extent[0], middle[1] + y * extent[1], middle[2] + z * extent[2]]);
  const facing = [0, 0, 0, 0, 0, 0]; // of the lower and of the upper sides
  const parts = drawn.map(({ shape, matrix }) => ({ shape, places: placed(shape.positions, matrix), front: Math.sign(determinant(matrix)), flat: new Uint8Array(shape.indices.length / 3) }));
  for (const { shape, places, front, flat } of parts)
    for (let k = 0; k < shape.indices.length; k += 3) {
      const corners = [3 * (shape.indices[k] ?? 0), 3 * (shape.indices[k + 1] ?? 0), 3 * (shape.indices[k + 2] ?? 0)];
      for (let side = 0; side < 6; side++) {
        const axis = side % 3;
        const limit = BAND * (extent[axis] ?? 0);
        const away = (/** @type {number} */ corner) => (side < 3 ? (places[corner + axis] ?? 0) - (low[axis] ?? 0) : (high[axis] ?? 0) - (places[corner + axis] ?? 0));
        if (away(corners[0] ?? 0) >= limit || !corners.every((corner) => away(corner) < limit)) continue;
        flat[k / 3] = 1;
        const agrees = !shape.normals || turned(shape.positions, shape.normals, corners) >= 0;
        facing[side] = (facing[side] ?? 0) + ((side < 3 ? 1 : -1) * front * (agrees ? 1 : -1) * (normalOf(places, corners)[axis] ?? 0)) / 2;
      }
    }
  const isCovered = (/** @type {number} */ side) => (facing[side] ?? 0) * (extent[side % 3] ?? 0) >= COVERED * extent[0] * extent[1] * extent[2];
  if (!isCovered(1) || [0, 2, 3, 5].filter(isCovered).length < WALLS) return null;
  const eyes = CORNERS.map(([x, z]) => at(OUT * x, EYE, OUT * z));
  const clear = eyes.map(() => Infinity);
  for (const { shape, places, flat } of parts)
    shape.indices.forEach((index, k) => {
      if (flat[Math.floor(k / 3)]) return;
      eyes.forEach((eye, i) => {
        const away = Math.hypot((places[3 * index] ?? 0) - eye[0], (places[3 * index + 1] ?? 0) - eye[1], (places[3 * index + 2] ?? 0) - eye[2]);
        if (away < (clear[i] ?? 0)) clear[i] = away;
      });
    });
  if (!clear.every(Number.isFinite)) return null; // nothing stands in it
  const first = clear.findIndex((away) => away >= CLEAR * Math.min(extent[0], extent[2]));
  const chosen = first < 0 ? clear.indexOf(Math.max(...clear)) : first;
  return { eye: /** @type {Vec3} */ (eyes[chosen]), target: at(0, TARGET, 0), up: [0, 1, 0], fov: FOV };
}

/** @param {Float32Array | Float64Array} positions @param {number[]} matrix column by column */
export function placed(positions, matrix) {
  const [a = 0, b = 0, c = 0, , d = 0, e = 0, f = 0, , g = 0, h = 0, i = 0, , tx = 0, ty = 0, tz = 0] = matrix;
  const found = new Float64Array(positions.length);
  for (let k = 0; k < positions.length; k += 3) {
    const [x, y, z] = [positions[k] ?? 0, positions[k + 1] ?? 0, positions[k + 2] ?? 0];
    found[k] = a * x + d * y + g * z + tx;
    found[k + 1] = b * x + e * y + h * z + ty;
    found[k + 2] = c * x + f * y + i * z + tz;
  }
  return found;
}

/** @param {number[]} matrix */
function determinant(matrix) {
  const [a = 0, b = 0, c = 0, , d = 0, e = 0, f = 0, , g = 0, h = 0, i = 0] = matrix;
  return a * (e * i - f * h) - d * (b * i - c * h) + g * (b * f - c * e);
}

/** Returns the normal of a triangle whose length is twice its area. @param {Float32Array | Float64Array} places @param {number[]} corners */
function normalOf(places, corners) {
  const [a = 0, b = 0, c = 0] = corners;
  const along = (/** @type {number} */ corner, /** @type {number} */ axis) => (places[corner + axis] ?? 0) - (places[a + axis] ?? 0);
  const [x, y, z] = [along(b, 0), along(b, 1), along(b, 2)];
  const [u, v, w] = [along(c, 0), along(c, 1), along(c, 2)];
  return [y * w - z * v, z * u - x * w, x * v - y * u];
}

/** Returns a value below 0 if a triangle's corners are clockwise where its normals point. @param {Float32Array | Float64Array} positions @param {Float32Array} normals @param {number[]} corners */
function turned(positions, normals, corners) {
  const normal = normalOf(positions, corners);
  return corners.reduce((sum, corner) => sum + normal.reduce((part, value, axis) => part + value * (normals[corner + axis] ?? 0), 0), 0);
}
