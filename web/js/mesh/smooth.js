/** Normals of shapes without any, as the service computes them (renderer/scene/normals.py): smooth over edges that bend little. */

import { boundsOf } from "./shapes.js";

/** @typedef {import("./shapes.js").Shape} Shape */

const CREASE = Math.cos((40 * Math.PI) / 180);
/** Faces at a point beyond which all of them are smoothed together. */
const MOST_VALENCE = 64;
/** Components of normals that differ by less are one. */
const SAME = 1e-4;

/**
 * Returns the shapes with normals. Those without are smoothed together, since a surface may have several materials: at a corner the mean of
 * the normals of all faces there, weighted by their angles, that differ from the corner's by less than the crease angle or, where there are smoothing groups,
 * that are in its group. Vertices with several normals are duplicated.
 *
 * @param {Shape[]} shapes
 * @returns {Shape[]}
 */
export function smoothed(shapes) {
  const bare = shapes.filter(({ normals }) => !normals);
  const count = bare.reduce((sum, { indices }) => sum + indices.length, 0);
  const points = new Uint32Array(count); // the point of each corner
  const total = weld(bare, points);
  const units = new Float32Array(count); // of the faces
  const angles = new Float32Array(count);
  const groups = new Int32Array(count / 3).fill(-1);
  let first = 0;
  for (const shape of bare) {
    measure(shape, first, units, angles);
    if (shape.groups) groups.set(shape.groups, first / 3);
    first += shape.indices.length;
  }
  const starts = new Uint32Array(total + 1);
  for (const point of points) starts[point + 1] = (starts[point + 1] ?? 0) + 1;
  for (let i = 0; i < total; i++) starts[i + 1] = (starts[i + 1] ?? 0) + (starts[i] ?? 0);
  const ends = starts.slice();
  const around = new Uint32Array(count); // corners, by their points
  for (let corner = 0; corner < count; corner++) {
    const point = points[corner] ?? 0;
    const at = ends[point] ?? 0;
    around[at] = corner;
    ends[point] = at + 1;
  }
  const normals = new Float32Array(3 * count); // of the corners
  /** Of points with many faces the first corner of each group. @type {Map<number, number>} */
  const firsts = new Map();
  for (let corner = 0; corner < count; corner++) {
    const point = points[corner] ?? 0;
    const [begin, end] = [starts[point] ?? 0, starts[point + 1] ?? 0];
    const face = corner - (corner % 3);
    const [ux, uy, uz, group] = [units[face] ?? 0, units[face + 1] ?? 0, units[face + 2] ?? 0, groups[face / 3] ?? 0];
    if (group && end - begin > MOST_VALENCE) {
      // All corners here that are of this group, or of no groups, have the same normal: the sum is computed once.
      const key = group * total + point;
      const known = firsts.get(key);
      if (known !== undefined) {
        normals.copyWithin(3 * corner, 3 * known, 3 * known + 3);
        continue;
      }
      firsts.set(key, corner);
    }
    let [x, y, z] = [0, 0, 0];
    for (let i = begin; i < end; i++) {
      const other = around[i] ?? 0;
      const at = other - (other % 3);
      const [vx, vy, vz] = [units[at] ?? 0, units[at + 1] ?? 0, units[at + 2] ?? 0];
      const isSmooth = at === face || (group < 0 ? end - begin > MOST_VALENCE || ux * vx + uy * vy + uz * vz >= CREASE : group > 0 && group === groups[at / 3]);
      if (!isSmooth) continue;
      const angle = angles[other] ?? 0;
      x += angle * vx;
      y += angle * vy;
      z += angle * vz;
    }
    const size = Math.sqrt(x * x + y * y + z * z) || 1;
    normals[3 * corner] = x / size;
    normals[3 * corner + 1] = y / size;
    normals[3 * corner + 2] = z / size;
  }
  first = 0;
  return shapes.map((shape) => {
    if (shape.normals) return shape;
    const own = normals.subarray(3 * first, 3 * (first + shape.indices.length));
    first += shape.indices.length;
    return withCornerNormals(shape, own);
  });
}

/**
 * Numbers the points of shapes: equal positions are one, whatever else their vertices have.
 *
 * @param {Shape[]} shapes
 * @param {Uint32Array} points of each corner, filled in
 * @returns {number} of points
 */
function weld(shapes, points) {
  const vertices = shapes.reduce((sum, { positions }) => sum + positions.length / 3, 0);
  const places = new Float32Array(3 * vertices);
  let at = 0;
  for (const { positions } of shapes) {
    for (let i = 0; i < positions.length; i++) places[at + i] = (positions[i] ?? 0) + 0; // -0 is 0
    at += positions.length;
  }
  const bits = new Int32Array(places.buffer);
  let slots = 1;
  while (slots < 2 * vertices) slots *= 2;
  const vertexAt = new Int32Array(slots).fill(-1); // a hash table with open addressing
  const pointOf = new Uint32Array(vertices);
  let count = 0;
  for (let i = 0; i < vertices; i++) {
    const x = bits[3 * i] ?? 0;
    const y = bits[3 * i + 1] ?? 0;
    const z = bits[3 * i + 2] ?? 0;
    let slot = Math.imul(Math.imul(x, 73856093) ^ Math.imul(y, 19349663) ^ Math.imul(z, 83492791), 0x9e3779b1);
    slot = (slot ^ (slot >>> 15)) & (slots - 1);
    for (;;) {
      const other = vertexAt[slot] ?? 0;
      if (other < 0) {
        vertexAt[slot] = i;
        pointOf[i] = count++;
        break;
      }
      if (bits[3 * other] === x && bits[3 * other + 1] === y && bits[3 * other + 2] === z) {
        pointOf[i] = pointOf[other] ?? 0;
        break;
      }
      slot = (slot + 1) & (slots - 1);
    }
  }
  let [vertex, corner] = [0, 0];
  for (const { positions, indices } of shapes) {
    for (const index of indices) points[corner++] = pointOf[vertex + index] ?? 0;
    vertex += positions.length / 3;
  }
  return count;
}

/**
 * Fills in the unit normals of a shape's faces, and the angles at its corners, 0 in faces without area.
 *
 * @param {Shape} shape
 * @param {number} first its first corner
 * @param {Float32Array} units three a face
 * @param {Float32Array} angles
 */
function measure({ positions, indices }, first, units, angles) {
  const { low, high } = boundsOf(positions);
  const scale = 1 / (Math.max(...high.map((value, i) => value - (low[i] ?? 0))) || 1); // squares of small numbers are 0
  const edge = new Float64Array(9);
  for (let k = 0; k < indices.length; k += 3) {
    for (let side = 0; side < 3; side++) {
      const from = 3 * (indices[k + side] ?? 0);
      const to = 3 * (indices[k + ((side + 1) % 3)] ?? 0);
      for (let axis = 0; axis < 3; axis++) edge[3 * side + axis] = ((positions[to + axis] ?? 0) - (positions[from + axis] ?? 0)) * scale;
    }
    const [ax = 0, ay = 0, az = 0, bx = 0, by = 0, bz = 0, cx = 0, cy = 0, cz = 0] = edge;
    const [x, y, z] = [ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx];
    const size = Math.sqrt(x * x + y * y + z * z);
    if (!size) continue;
    units[first + k] = x / size;
    units[first + k + 1] = y / size;
    units[first + k + 2] = z / size;
    angles[first + k] = Math.atan2(size, -(ax * cx + ay * cy + az * cz));
    angles[first + k + 1] = Math.atan2(size, -(bx * ax + by * ay + bz * az));
    angles[first + k + 2] = Math.atan2(size, -(cx * bx + cy * by + cz * bz));
  }
}

/** Returns a shape whose vertices have the normals of its corners. @param {Shape} shape @param {Float32Array} normals three a corner @returns {Shape} */
export function withCornerNormals({ positions, uvs, colors, groups, indices }, normals) {
  const nextOf = new Int32Array(indices.length).fill(-1); // further vertices of the same original
  const headOf = new Int32Array(positions.length / 3).fill(-1);
  const cornerOf = new Uint32Array(indices.length); // of each new vertex
  const numbers = new Uint32Array(indices.length);
  let count = 0;
  for (let corner = 0; corner < indices.length; corner++) {
    const original = indices[corner] ?? 0;
    const [x, y, z] = [normals[3 * corner] ?? 0, normals[3 * corner + 1] ?? 0, normals[3 * corner + 2] ?? 0];
    let vertex = headOf[original] ?? -1;
    for (; vertex >= 0; vertex = nextOf[vertex] ?? -1) {
      const at = 3 * (cornerOf[vertex] ?? 0);
      if (Math.abs((normals[at] ?? 0) - x) < SAME && Math.abs((normals[at + 1] ?? 0) - y) < SAME && Math.abs((normals[at + 2] ?? 0) - z) < SAME) break;
    }
    if (vertex < 0) {
      vertex = count++;
      cornerOf[vertex] = corner;
      nextOf[vertex] = headOf[original] ?? -1;
      headOf[original] = vertex;
    }
    numbers[corner] = vertex;
  }
  /** @type {Shape} */
  const found = {
    ...{ positions: new Float32Array(3 * count), normals: new Float32Array(3 * count), uvs: uvs && new Float32Array(2 * count) },
    ...{ colors: colors && new Uint8Array(3 * count), groups, indices: numbers },
  };
  for (let i = 0; i < count; i++) {
    const corner = cornerOf[i] ?? 0;
    const original = indices[corner] ?? 0;
    for (let axis = 0; axis < 3; axis++) {
      found.positions[3 * i + axis] = positions[3 * original + axis] ?? 0;
      if (found.normals) found.normals[3 * i + axis] = normals[3 * corner + axis] ?? 0;
      if (colors && found.colors) found.colors[3 * i + axis] = colors[3 * original + axis] ?? 0;
    }
    if (uvs && found.uvs) {
      found.uvs[2 * i] = uvs[2 * original] ?? 0;
      found.uvs[2 * i + 1] = uvs[2 * original + 1] ?? 0;
    }
  }
  return found;
}
