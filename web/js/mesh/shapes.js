/**
 * Triangles in the making, between a reader of files and the preview mesh: decimating, joining in world space, and the camera that
 * frames them. renderer/scene/preview.py and default_camera.py do the same for the service's preview.
 */

import { emittersOf } from "./emitters.js";
import { cofactors } from "./matrix.js";
import { MATT } from "./surface.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../news/mesh-packet.js").Lamp} Lamp */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/**
 * What a reader returns.
 *
 * @typedef {object} LocalMesh
 * @property {MeshPacket} packet
 * @property {View} view
 * @property {boolean} isWhole false: parts are missing, not posed, or coloured differently by the service
 * @property {Picture[]} images as numbered by the packet's parts
 */
/** An image file. @typedef {{bytes: Uint8Array<ArrayBuffer>, type: string, sampler?: import("../news/mesh-packet.js").Sampler}} Picture */
/**
 * Triangles in their own space.
 *
 * @typedef {object} Shape
 * @property {Float32Array} positions three a vertex
 * @property {Float32Array | null} normals three a vertex; null: to be computed
 * @property {Float32Array | null} uvs two a vertex
 * @property {Uint32Array} indices three a triangle
 * @property {Uint8Array | null} [colors] three a vertex, sRGB
 * @property {Int32Array | null} [groups] smoothing group of each triangle; 0: flat
 */
/**
 * A shape in the scene.
 *
 * @typedef {object} Drawn
 * @property {Shape} shape
 * @property {number[]} matrix to world space, column by column
 * @property {number[]} color sRGB, and opacity
 * @property {import("../news/mesh-packet.js").MeshMaterial} material
 */

export const MOST_TRIANGLES = 150_000;
const FEWEST = 24; // triangles of a decimated shape
const EXCESS = 1.5; // at which a shape is decimated again
const MOST_CORNERS = 6_000_000; // of all triangles after decimation
const MOST_MATERIALS = 1000; // each is drawn by a call of its own; shapes of further ones are matt, in their own colours
const STEPS = 65535;

/** The service's automatic camera (renderer/scene/default_camera.py). */
const FOV = 35;
const MARGIN = 1.25;
const CENTRING_STEPS = 8;
const ASPECT = 3 / 2;
const SAMPLED = 50_000; // vertices

/** Returns a shape with about a share of its triangles. @param {Shape} given @param {number} share @returns {Shape} */
export function decimated(given, share) {
  const shape = compacted(given);
  const target = Math.max(share * (shape.indices.length / 3), FEWEST);
  let found = shape;
  const count = () => found.indices.length / 3;
  // A flat grid of cells gives two triangles a cell, a closed surface several times as many.
  for (let cells = Math.sqrt(target / 2); count() > EXCESS * target && cells >= 2; cells *= 0.9 * Math.sqrt(target / count()))
    found = clustered(shape, cells);
  return found;
}

/**
 * Decimates: replaces all vertices in a cell of a grid by one of them (Rossignac and Borrel 1993), as renderer/scene/preview.py does.
 *
 * @param {Shape} shape
 * @param {number} cells along the longest side
 * @returns {Shape}
 */
function clustered(shape, cells) {
  const { positions, indices, groups } = shape;
  if (!positions.every(Number.isFinite)) throw new RangeError("a position is not finite");
  const { low, high } = boundsOf(positions);
  const size = Math.max(...high.map((value, i) => value - (low[i] ?? 0)), 1e-30) / cells;
  const side = Math.floor(cells) + 2;
  const [x0, y0, z0] = low;
  const vertices = positions.length / 3;
  let slots = 1; // of a hash table with open addressing: cells, and the number of each cell's vertex among the kept
  while (slots < 2 * vertices) slots *= 2;
  const cellAt = new Float64Array(slots).fill(-1);
  const keptAt = new Uint32Array(slots);
  const keptOf = new Uint32Array(vertices);
  const kept = new Uint32Array(vertices);
  let count = 0;
  for (let i = 0; i < vertices; i++) {
    const x = Math.floor(((positions[3 * i] ?? 0) - x0) / size);
    const y = Math.floor(((positions[3 * i + 1] ?? 0) - y0) / size);
    const z = Math.floor(((positions[3 * i + 2] ?? 0) - z0) / size);
    const cell = (x * side + y) * side + z;
    let slot = (Math.imul(x, 73856093) ^ Math.imul(y, 19349663) ^ Math.imul(z, 83492791)) & (slots - 1);
    while (cellAt[slot] !== -1 && cellAt[slot] !== cell) slot = (slot + 1) & (slots - 1);
    if (cellAt[slot] === -1) {
      cellAt[slot] = cell;
      keptAt[slot] = count;
      kept[count++] = i;
    }
    keptOf[i] = keptAt[slot] ?? 0;
  }
  const corners = new Uint32Array(indices.length);
  const groupOf = groups && new Int32Array(groups.length);
  let length = 0;
  for (let i = 0; i < indices.length; i += 3) {
    const a = keptOf[indices[i] ?? 0] ?? 0;
    const b = keptOf[indices[i + 1] ?? 0] ?? 0;
    const c = keptOf[indices[i + 2] ?? 0] ?? 0;
    if (a === b || b === c || c === a) continue;
    if (groups && groupOf) groupOf[length / 3] = groups[i / 3] ?? 0;
    corners[length++] = a;
    corners[length++] = b;
    corners[length++] = c;
  }
  return { ...verticesOf(shape, kept.subarray(0, count)), groups: groupOf && groupOf.slice(0, length / 3), indices: corners.slice(0, length) };
}

/** Returns a shape without the vertices that no triangle has: several shapes may be cut from one table of vertices. @param {Shape} shape @returns {Shape} */
function compacted(shape) {
  if (shape.positions.length / 3 <= shape.indices.length) return shape;
  /** @type {Map<number, number>} */
  const numbers = new Map();
  const indices = shape.indices.map((index) => {
    const number = numbers.get(index) ?? numbers.size;
    numbers.set(index, number);
    return number;
  });
  return { ...shape, ...verticesOf(shape, Uint32Array.from(numbers.keys())), indices };
}

/** Returns what some vertices of a shape have. @param {Shape} shape @param {Uint32Array} kept their numbers */
function verticesOf({ positions, normals, uvs, colors }, kept) {
  /** @template {Float32Array | Uint8Array} A @param {A} source @param {number} width @param {A} found */
  const picked = (source, width, found) => {
    for (let i = 0; i < kept.length; i++) {
      const at = width * (kept[i] ?? 0);
      for (let k = 0; k < width; k++) found[width * i + k] = source[at + k] ?? 0;
    }
    return found;
  };
  const floats = (/** @type {Float32Array} */ source, /** @type {number} */ width) => picked(source, width, new Float32Array(width * kept.length));
  return { positions: floats(positions, 3), normals: normals && floats(normals, 3), uvs: uvs && floats(uvs, 2), colors: colors && picked(colors, 3, new Uint8Array(3 * kept.length)) };
}

/** @param {Float32Array | Float64Array} positions @returns {{low: Vec3, high: Vec3}} */
export function boundsOf(positions) {
  /** @type {Vec3} */
  const low = [Infinity, Infinity, Infinity];
  /** @type {Vec3} */
  const high = [-Infinity, -Infinity, -Infinity];
  for (const axis of /** @type {const} */ ([0, 1, 2]))
    for (let i = axis; i < positions.length; i += 3) {
      const value = positions[i] ?? 0;
      if (value < low[axis]) low[axis] = value;
      if (value > high[axis]) high[axis] = value;
    }
  return { low, high };
}

/** sRGB's transfer function. @param {number} value */
export const encoded = (value) => (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055);

/**
 * Joins shapes in world space, those of the same material one after the other.
 *
 * @param {Drawn[]} given
 * @param {Lamp[]} lamps of the file, which shine in a black world; without any, the studio lights the scene, unless shining surfaces do
 * @returns {{packet: MeshPacket, places: Float64Array, hasAllMaterials: boolean} | null} places: of the vertices. null if any, or a value of a
 *   material or a lamp, is not finite, or if they are too many
 */
export function joined(given, lamps) {
  if (!lamps.every(hasFiniteValues)) return null;
  /** @type {Map<string, {material: import("../news/mesh-packet.js").MeshMaterial, drawn: Drawn[]}>} */
  const byMaterial = new Map();
  for (const each of given) {
    const own = JSON.stringify(each.material);
    const isFurther = !byMaterial.has(own) && byMaterial.size >= MOST_MATERIALS;
    const [key, material] = isFurther ? [FURTHER, MATT] : [own, each.material];
    const known = byMaterial.get(key);
    if (known) known.drawn.push(each);
    else if (!hasFiniteValues(material)) return null;
    else byMaterial.set(key, { material, drawn: [each] });
  }
  const drawn = [...byMaterial.values()].flatMap(({ drawn: same, material }, number) => same.map((each) => ({ ...each, material, number })));
  const vertices = drawn.reduce((sum, { shape }) => sum + shape.positions.length / 3, 0);
  const corners = drawn.reduce((sum, { shape }) => sum + shape.indices.length, 0);
  if (Math.max(vertices, corners) > MOST_CORNERS) return null;
  const places = new Float64Array(3 * vertices);
  const normals = new Int8Array(4 * vertices);
  const colors = new Uint8Array(4 * vertices);
  const indices = new Uint32Array(corners);
  const uvs = drawn.some(({ material }) => isTextured(material)) ? new Float32Array(2 * vertices) : undefined;
  /** @type {import("../news/mesh-packet.js").MeshPart[]} */
  const parts = [];
  let [vertex, corner] = [0, 0];
  for (const { shape, matrix, color, material, number } of drawn) {
    const [a = 0, b = 0, c = 0, , d = 0, e = 0, f = 0, , g = 0, h = 0, i = 0, , tx = 0, ty = 0, tz = 0] = matrix;
    const [n0 = 0, n1 = 0, n2 = 0, n3 = 0, n4 = 0, n5 = 0, n6 = 0, n7 = 0, n8 = 0] = cofactors(matrix);
    const first = vertex;
    const { positions, normals: own, colors: painted } = shape;
    for (let k = 0; k < positions.length; k += 3, vertex++) {
      const x = positions[k] ?? 0;
      const y = positions[k + 1] ?? 0;
      const z = positions[k + 2] ?? 0;
      places[3 * vertex] = a * x + d * y + g * z + tx;
      places[3 * vertex + 1] = b * x + e * y + h * z + ty;
      places[3 * vertex + 2] = c * x + f * y + i * z + tz;
      if (own) {
        const u = own[k] ?? 0;
        const v = own[k + 1] ?? 0;
        const w = own[k + 2] ?? 0;
        const nx = n0 * u + n3 * v + n6 * w;
        const ny = n1 * u + n4 * v + n7 * w;
        const nz = n2 * u + n5 * v + n8 * w;
        const size = 127 / (Math.sqrt(nx * nx + ny * ny + nz * nz) || 1);
        normals[4 * vertex] = Math.round(nx * size);
        normals[4 * vertex + 1] = Math.round(ny * size);
        normals[4 * vertex + 2] = Math.round(nz * size);
      }
      colors.set(color, 4 * vertex);
      if (painted) for (let axis = 0; axis < 3; axis++) colors[4 * vertex + axis] = product(painted[k + axis] ?? 0, color[axis] ?? 0);
    }
    if (isTextured(material) && shape.uvs) uvs?.set(shape.uvs, 2 * first);
    const last = parts.at(-1);
    if (last?.material === number) last.corners += shape.indices.length;
    else parts.push({ material: number, first: corner, corners: shape.indices.length });
    for (const index of shape.indices) indices[corner++] = first + index;
  }
  const { low, high } = boundsOf(places);
  if (![...low, ...high].every(Number.isFinite) || places.some(Number.isNaN)) return null;
  const positions = new Uint16Array(4 * vertices);
  const scale = low.map((value, axis) => STEPS / ((high[axis] ?? 0) - value || 1));
  for (let k = 0; k < vertices; k++)
    for (let axis = 0; axis < 3; axis++) positions[4 * k + axis] = Math.round(((places[3 * k + axis] ?? 0) - (low[axis] ?? 0)) * (scale[axis] ?? 0));
  const materials = [...byMaterial.values()].map(({ material }) => material);
  /** @type {MeshPacket} */
  const packet = { vertices, triangles: corners / 3, low, high, positions, normals, colors, indices, ...(uvs && { uvs }), parts, materials, textures: [], lamps, environment: null, isStudio: false };
  if (!lamps.length) packet.lamps = emittersOf(packet, places);
  packet.isStudio = !packet.lamps.length;
  return { packet, places, hasAllMaterials: !byMaterial.has(FURTHER) };
}

/** Key of the material that stands for those beyond MOST_MATERIALS. */
const FURTHER = "";

/** Whether a record has only finite numbers, besides flags and names of alpha modes: a file may state anything. @param {object} record */
const hasFiniteValues = (record) => Object.values(record).flat().every((value) => Number.isFinite(value) || typeof value === "boolean" || ["opaque", "mask", "blend"].includes(value));

/** @param {import("../news/mesh-packet.js").MeshMaterial} material */
const isTextured = (material) => Math.max(material.texture, material.metallic_roughness_texture, material.emission_texture) >= 0;

/** Linear values of sRGB's 256. */
const LINEAR = Float64Array.from({ length: 256 }, (_, code) => (code <= 0.04045 * 255 ? code / 255 / 12.92 : ((code / 255 + 0.055) / 1.055) ** 2.4));

/** Returns the product of two colour values, from 0 to 255, sRGB. @param {number} a @param {number} b */
const product = (a, b) => (a === 255 ? b : b === 255 ? a : Math.round(255 * encoded((LINEAR[a] ?? 0) * (LINEAR[b] ?? 0))));

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];

/** @param {Vec3} vector @returns {Vec3} */
const unit = (vector) => /** @type {Vec3} */ (vector.map((value) => value / Math.hypot(...vector)));

/**
 * Moves an eye nearer to where the projections of points reach equally far to both sides, on two axes.
 *
 * @param {Float64Array} places
 * @param {number} step between the points that are looked at, in numbers
 * @param {Vec3[]} axes to the right and upwards
 * @param {Vec3} back from the scene to the eye
 * @param {number} away position of the eye along `back`
 * @param {number[]} at its positions on the axes, which are changed
 */
function centre(places, step, axes, back, away, at) {
  axes.forEach(([ax, ay, az], i) => {
    const from = at[i] ?? 0;
    let [first, firstScale, last, lastScale] = [Infinity, 1, -Infinity, 1];
    for (let k = 0; k < places.length; k += step) {
      const x = places[k] ?? 0;
      const y = places[k + 1] ?? 0;
      const z = places[k + 2] ?? 0;
      const scale = 1 / (away - (x * back[0] + y * back[1] + z * back[2]));
      const seen = (x * ax + y * ay + z * az - from) * scale;
      if (seen < first) [first, firstScale] = [seen, scale];
      if (seen > last) [last, lastScale] = [seen, scale];
    }
    if (last >= first) at[i] = from + (first + last) / (firstScale + lastScale);
  });
}

/**
 * Returns the view that frames points with room around them: by default as the service's automatic camera does.
 *
 * @param {Float64Array} places
 * @param {Vec3} [towards] direction from the scene to the camera, of any length, not along `up`
 * @param {Vec3} [up] unit vector
 * @returns {View}
 */
export function frame(places, towards = [0.62, 0.42, 1], up = [0, 1, 0]) {
  const back = unit(towards);
  const right = unit(cross(up, back));
  const above = cross(back, right);
  const tall = Math.tan((FOV * Math.PI) / 360) / MARGIN;
  const slopes = [tall * ASPECT, tall];
  // For each axis the points determine the two planes of the frustum, and the eye is on their intersection.
  const highest = [-Infinity, -Infinity];
  const lowest = [-Infinity, -Infinity];
  let [nearest, farthest] = [-Infinity, Infinity];
  const step = 3 * (Math.floor(places.length / 3 / SAMPLED) + 1);
  for (let k = 0; k < places.length; k += step) {
    const x = places[k] ?? 0;
    const y = places[k + 1] ?? 0;
    const z = places[k + 2] ?? 0;
    const depth = x * back[0] + y * back[1] + z * back[2];
    nearest = Math.max(nearest, depth);
    farthest = Math.min(farthest, depth);
    for (const i of /** @type {const} */ ([0, 1])) {
      const axis = i ? above : right;
      const across = x * axis[0] + y * axis[1] + z * axis[2];
      const sloped = (slopes[i] ?? 0) * depth;
      highest[i] = Math.max(highest[i] ?? -Infinity, across + sloped);
      lowest[i] = Math.max(lowest[i] ?? -Infinity, sloped - across);
    }
  }
  const at = [0, 1].map((i) => ((highest[i] ?? 0) - (lowest[i] ?? 0)) / 2);
  const { low, high } = boundsOf(places);
  const size = Math.max(...high.map((value, i) => value - (low[i] ?? 0)), 1e-6);
  const reach = [0, 1].map((i) => ((highest[i] ?? 0) + (lowest[i] ?? 0)) / (2 * (slopes[i] ?? 1)));
  const away = Math.max(...reach, nearest + 0.05 * size);
  for (let n = 0; n < CENTRING_STEPS; n++) centre(places, step, [right, above], back, away, at);
  const point = (/** @type {number} */ depth) => /** @type {Vec3} */ ([0, 1, 2].map((i) => (at[0] ?? 0) * (right[i] ?? 0) + (at[1] ?? 0) * (above[i] ?? 0) + depth * (back[i] ?? 0)));
  return { eye: point(away), target: point((nearest + farthest) / 2), up, fov: FOV };
}

/**
 * Returns the view of a file's camera, whose target is as far as the middle of the scene, as the view turns about it.
 *
 * @param {Vec3} eye
 * @param {Vec3} back from the scene to the camera
 * @param {Vec3} up
 * @param {number} fov vertical, in degrees
 * @param {Vec3} low lower corner of the scene
 * @param {Vec3} high
 * @returns {View | null} null if the file's values make no camera
 */
export function orbitView(eye, back, up, fov, low, high) {
  const size = Math.hypot(...back) || 1;
  const middle = eye.reduce((sum, value, i) => sum + ((value - ((low[i] ?? 0) + (high[i] ?? 0)) / 2) * (back[i] ?? 0)) / size, 0);
  const away = middle > 0 ? middle : 1;
  const target = /** @type {Vec3} */ (eye.map((value, i) => value - (away * (back[i] ?? 0)) / size));
  const isCamera = fov > 0 && fov < 180 && Math.hypot(...up) > 0 && [...eye, ...target, ...up].every(Number.isFinite);
  return isCamera ? { eye, target, up, fov } : null;
}
