/** The shapes of a preview mesh's parts: where they are, and which of them are balls or rectangles, that rays are intersected with exactly. */

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/** @typedef {import("../news/mesh-packet.js").MeshPart} MeshPart */

/**
 * Where a part is, relative to the mesh's middle. middle: approximately. size: its longest extent. isDense: it has more than DENSE corners, and normals. isBall:
 * its normals are about those of one. radius: of the ball that it is, whose centre the middle then is; 0: it is none. isOutside: it lies in a side of the mesh's bounds.
 *
 * @typedef {{middle: Vec3, size: number, isDense: boolean, isBall: boolean, radius: number, isOutside: boolean}} Place
 */

/** Corners from which a part is shaded at its vertices. */
const DENSE = 300_000;
/** Corners of a part that its middle is computed from. */
const SAMPLED = 64;
/** Mean cosine of the angles between a part's normals and the directions from its middle, above which the part counts as a ball. */
const ROUND = 0.9;
/** Fewest and most corners of an exact ball, and how far its vertices and extents may be from it, in radii. */
const [FEWEST_CORNERS, MOST_CORNERS, UNEVEN] = [180, 100_000, 0.015];
/** Thickness of what counts as flat, and difference of an area from its rectangle's, in proportion. */
const [FLAT, UNFILLED] = [1e-3, 0.03];

/** @param {number[]} a @param {number[]} b */
const dot = (a, b) => a.reduce((sum, value, i) => sum + value * (b[i] ?? 0), 0);
/** @param {number[]} vector @returns {Vec3} */
const unit = (vector) => /** @type {Vec3} */ (vector.map((value) => value / (Math.hypot(...vector) || 1)));
/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** Returns a function that reads the place of a corner, relative to the mesh's middle. @param {MeshPacket} mesh @returns {(corner: number) => Vec3} */
function placesOf({ positions, indices, low, high }) {
  const scale = high.map((value, axis) => (value - (low[axis] ?? 0)) / 65535);
  return (corner) => {
    const at = 4 * (indices[corner] ?? 0);
    return /** @type {Vec3} */ (scale.map((step, axis) => ((positions[at + axis] ?? 0) - 32767.5) * step));
  };
}

/** @param {MeshPacket} mesh @param {MeshPart} part @returns {Place} */
export function placeOf(mesh, { first, corners }) {
  const { normals, indices, low, high } = mesh;
  const placeAt = placesOf(mesh);
  const step = Math.max(1, Math.floor(corners / SAMPLED));
  let isDense = corners > DENSE;
  const sum = [0, 0, 0];
  const [least, most] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  const isWhole = corners <= MOST_CORNERS;
  let sampled = 0;
  for (let i = first; i < first + corners; i += isWhole ? 1 : step, sampled++) {
    const at = 4 * (indices[i] ?? 0);
    isDense &&= normals[at] !== 0 || normals[at + 1] !== 0 || normals[at + 2] !== 0;
    placeAt(i).forEach((value, axis) => {
      sum[axis] = (sum[axis] ?? 0) + value;
      least[axis] = Math.min(least[axis] ?? 0, value);
      most[axis] = Math.max(most[axis] ?? 0, value);
    });
  }
  const extents = most.map((value, axis) => value - (least[axis] ?? 0));
  const mean = /** @type {Vec3} */ (sum.map((value) => value / sampled));
  let facing = 0;
  for (let i = first; i < first + corners; i += step) {
    const at = 4 * (indices[i] ?? 0);
    const out = unit(placeAt(i).map((value, axis) => value - (mean[axis] ?? 0)));
    facing += dot(out, [normals[at] ?? 0, normals[at + 1] ?? 0, normals[at + 2] ?? 0]) / 127 / Math.ceil(corners / step);
  }
  const isBall = facing > ROUND;
  const size = Math.max(...extents);
  const centre = /** @type {Vec3} */ (most.map((value, axis) => (value + (least[axis] ?? 0)) / 2));
  const isEven = isBall && isWhole && corners >= FEWEST_CORNERS && extents.every((value) => value > (1 - 2 * UNEVEN) * size);
  let radius = isEven ? size / 2 : 0;
  for (let i = first; radius && i < first + corners; i++) {
    const away = Math.hypot(...placeAt(i).map((value, axis) => value - (centre[axis] ?? 0)));
    if (Math.abs(away - radius) > UNEVEN * radius) radius = 0;
  }
  const half = high.map((value, axis) => (value - (low[axis] ?? 0)) / 2);
  const thick = FLAT * Math.max(...half);
  const isOutside = isWhole && extents.some((value, axis) => value <= thick && Math.abs(centre[axis] ?? 0) >= (half[axis] ?? 0) - thick);
  return { middle: radius ? centre : mean, size, isDense, isBall, radius, isOutside };
}

/**
 * Returns the rectangle that a part is, relative to the mesh's middle; null if it is none.
 *
 * @param {MeshPacket} mesh
 * @param {MeshPart} part
 * @returns {{middle: Vec3, halves: [Vec3, Vec3]} | null} halves: from the middle to those of two sides
 */
export function rectangleOf(mesh, { first, corners }) {
  if (corners > MOST_CORNERS) return null;
  const placeAt = placesOf(mesh);
  const origin = placeAt(first);
  const from = (/** @type {number} */ corner) => /** @type {Vec3} */ (placeAt(corner).map((value, axis) => value - (origin[axis] ?? 0)));
  const [a, b] = [from(first + 1), from(first + 2)];
  const normal = unit(cross(a, b));
  let area = 0;
  for (let i = first; i < first + corners; i += 3) {
    const at = from(i);
    const [u, v] = /** @type {[Vec3, Vec3]} */ ([1, 2].map((k) => from(i + k).map((value, axis) => value - (at[axis] ?? 0))));
    area += Math.hypot(...cross(u, v)) / 2;
  }
  for (const edge of [a, b, a.map((value, axis) => value - (b[axis] ?? 0))]) {
    const axes = [unit(edge), cross(normal, unit(edge)), normal];
    const [least, most] = [axes.map(() => Infinity), axes.map(() => -Infinity)];
    for (let i = first; i < first + corners; i++)
      axes.forEach((axis, k) => {
        const along = dot(from(i), axis);
        least[k] = Math.min(least[k] ?? 0, along);
        most[k] = Math.max(most[k] ?? 0, along);
      });
    const [width = 0, height = 0, thick = 0] = most.map((value, k) => value - (least[k] ?? 0));
    if (!(width * height > 0) || thick > FLAT * Math.max(width, height) || Math.abs(area / (width * height) - 1) > UNFILLED) continue;
    const along = (/** @type {number} */ k, /** @type {number} */ share) => /** @type {Vec3} */ (axes[k]?.map((value) => share * value));
    const middle = axes.reduce((sum, axis, k) => sum.map((value, i) => value + (axis[i] ?? 0) * (((least[k] ?? 0) + (most[k] ?? 0)) / 2)), /** @type {number[]} */ (origin));
    return { middle: /** @type {Vec3} */ (middle), halves: [along(0, width / 2), along(1, height / 2)] };
  }
  return null;
}
