/** Cuts polygons into triangles. */

/** @typedef {import("./shapes.js").Vec3} Vec3 */

const MOST_CLIPPED = 256; // corners; larger polygons are cut into fans, since clipping takes the square of their number

/**
 * Returns the corners of a polygon's triangles, three each, as numbers from 0: a fan where the polygon is convex, else the ears that are
 * clipped one after the other. Source: Meisters 1975, as in renderer/scene/ear_clipping.py.
 *
 * @param {number} count of corners
 * @param {(corner: number) => Vec3} place
 * @returns {number[]}
 */
export function trianglesOf(count, place) {
  const fan = Array.from({ length: Math.max(count - 2, 0) }, (_, i) => [0, i + 1, i + 2]).flat();
  if (count < 4 || count > MOST_CLIPPED) return fan;
  const points = flattened(Array.from({ length: count }, (_, corner) => place(corner)));
  const turn = (/** @type {number} */ a, /** @type {number} */ b, /** @type {number} */ c) => {
    const [[px = 0, py = 0] = [], [qx = 0, qy = 0] = [], [rx = 0, ry = 0] = []] = [points[a], points[b], points[c]];
    return (qx - px) * (ry - py) - (qy - py) * (rx - px);
  };
  if (points.every((_, i) => turn((i + count - 1) % count, i, (i + 1) % count) >= 0)) return fan;
  const left = points.map((_, i) => i);
  const found = [];
  while (left.length > 3) {
    const ear = left.findIndex((b, i) => {
      const [a, c] = [/** @type {number} */ (left.at(i - 1)), /** @type {number} */ (left[(i + 1) % left.length])];
      const isInside = (/** @type {number} */ p) => turn(a, b, p) >= 0 && turn(b, c, p) >= 0 && turn(c, a, p) >= 0;
      return turn(a, b, c) > 0 && !left.some((p) => p !== a && p !== b && p !== c && isInside(p));
    });
    if (ear < 0) return fan; // it crosses itself
    found.push(/** @type {number} */ (left.at(ear - 1)), /** @type {number} */ (left[ear]), /** @type {number} */ (left[(ear + 1) % left.length]));
    left.splice(ear, 1);
  }
  return [...found, ...left];
}

/**
 * Returns whether the diagonal from the first corner of a quadrilateral cuts it into two triangles on the same side. If not, the other
 * diagonal does.
 *
 * @param {Float64Array} points three values each
 * @param {number} a number of a corner's point, as the others
 * @param {number} b
 * @param {number} c
 * @param {number} d
 */
export function isCutFromFirst(points, a, b, c, d) {
  const at = (/** @type {number} */ point, /** @type {number} */ axis) => points[3 * point + axis] ?? 0;
  let sum = 0;
  for (let axis = 0; axis < 3; axis++) {
    const [u, v] = axis === 0 ? [1, 2] : axis === 1 ? [2, 0] : [0, 1];
    const [p, q] = [at(c, u) - at(a, u), at(c, v) - at(a, v)];
    sum += ((at(b, u) - at(a, u)) * q - (at(b, v) - at(a, v)) * p) * (p * (at(d, v) - at(a, v)) - q * (at(d, u) - at(a, u)));
  }
  return sum >= 0;
}

/** Returns corners in the plane of their polygon, which is counterclockwise there: the two axes across its normal's largest part. @param {Vec3[]} corners @returns {[number, number][]} */
function flattened(corners) {
  const normal = [0, 0, 0];
  corners.forEach((a, i) => {
    const b = corners[(i + 1) % corners.length] ?? a;
    for (let axis = 0; axis < 3; axis++) {
      const [u, v] = [(axis + 1) % 3, (axis + 2) % 3];
      normal[axis] = (normal[axis] ?? 0) + ((a[u] ?? 0) - (b[u] ?? 0)) * ((a[v] ?? 0) + (b[v] ?? 0));
    }
  });
  const sizes = normal.map(Math.abs);
  const axis = sizes.indexOf(Math.max(...sizes));
  const [u, v] = (normal[axis] ?? 0) < 0 ? [(axis + 2) % 3, (axis + 1) % 3] : [(axis + 1) % 3, (axis + 2) % 3];
  return corners.map((corner) => [corner[u] ?? 0, corner[v] ?? 0]);
}
