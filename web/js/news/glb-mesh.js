/**
 * Reads a GLB file in the browser as far as its preview needs: triangles with normals, base colours and their textures.
 *
 * The service's preview mesh (renderer/scene/preview.py), whose colours are per vertex, replaces it if the file has no textures, or
 * has what is not read here, such as poses.
 */

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("./mesh-packet.js").MeshPacket} MeshPacket */
/**
 * @typedef {object} LocalMesh
 * @property {MeshPacket} packet
 * @property {View} view
 * @property {boolean} isWhole false: parts are missing or not posed
 */
/** An image file in the GLB. @typedef {{bytes: Uint8Array<ArrayBuffer>, type: string}} Picture */

export const MOST_TRIANGLES = 150_000;
const FEWEST = 24; // triangles of a decimated primitive
const EXCESS = 1.5; // at which a primitive is decimated again
const MOST_INSTANCES = 20_000;
const MOST_DEPTH = 64;
const BLENDED = 0.5; // alpha below which blended surfaces are left out, since nothing is sorted

const MAGIC = 0x46546c67;
const JSON_CHUNK = 0x4e4f534a;
const BIN_CHUNK = 0x004e4942;
const TRIANGLES = 4;
const STEPS = 65535;

/** glTF's component types: array, bytes, and the divisor of normalised values. */
const COMPONENTS = /** @type {Record<number, {array: any, size: number, unit: number}>} */ ({
  5120: { array: Int8Array, size: 1, unit: 127 },
  5121: { array: Uint8Array, size: 1, unit: 255 },
  5122: { array: Int16Array, size: 2, unit: 32767 },
  5123: { array: Uint16Array, size: 2, unit: 65535 },
  5125: { array: Uint32Array, size: 4, unit: 1 },
  5126: { array: Float32Array, size: 4, unit: 1 },
});
const WIDTHS = /** @type {Record<string, number>} */ ({ SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 });

/** The service's automatic camera (renderer/scene/default_camera.py). */
const FOV = 35;
const MARGIN = 1.06;
const ASPECT = 4 / 3;
const SAMPLED = 50_000; // vertices

/** A primitive in its own space, decimated. @typedef {{positions: Float32Array, normals: Float32Array | null, uvs: Float32Array | null, indices: Uint32Array}} Shape */
/** A base colour texture: its image, the UV set and transform (a, b, c, d, e, f), and the alpha below which nothing is seen. @typedef {{image: number, set: number, transform: number[], cutoff: number}} Surface */

/**
 * @param {ArrayBuffer} buffer of the file
 * @param {number} [most] triangles, about
 * @returns {(LocalMesh & {images: Picture[]}) | null} images: as numbered by the packet's parts. null if the file is malformed, has no triangles, or is compressed
 */
export function readGlb(buffer, most = MOST_TRIANGLES) {
  const parts = chunks(buffer);
  if (!parts) return null;
  const { gltf, bin } = parts;
  const all = instances(gltf);
  const placed = all.slice(0, MOST_INSTANCES);
  const total = placed.reduce((sum, { primitive }) => sum + triangleCount(gltf, primitive), 0);
  if (!total) return null;
  const share = Math.min(1, most / total);
  /** @type {Map<object, Shape | null>} */
  const shapes = new Map();
  /** @type {Drawn[]} */
  const drawn = [];
  /** @type {Map<number, Picture>} */
  const pictures = new Map();
  for (const { primitive, matrix } of placed) {
    const material = gltf.materials?.[primitive.material];
    const surface = surfaceOf(gltf, material);
    if (!shapes.has(primitive)) shapes.set(primitive, shapeOf(gltf, bin, primitive, share, surface));
    const shape = shapes.get(primitive);
    if (!shape) continue;
    const picture = surface && shape.uvs && (pictures.get(surface.image) ?? pictureOf(gltf, bin, surface.image));
    if (picture) pictures.set(surface.image, picture);
    drawn.push({ shape, matrix, color: colorOf(material), surface: picture ? surface : null });
  }
  if (!drawn.length) return null;
  const numbers = [...pictures.keys()];
  drawn.sort((a, b) => order(a.surface, numbers) - order(b.surface, numbers));
  const found = joined(drawn, gltf, numbers);
  const isWhole = drawn.length === all.length && !(gltf.nodes ?? []).some((/** @type {any} */ node) => node.skin !== undefined || node.weights) && !gltf.extensions?.KHR_materials_variants;
  return found && { ...found, isWhole, images: [...pictures.values()] };
}

/** @typedef {{shape: Shape, matrix: number[], color: number[], surface: Surface | null}} Drawn */

/** Textured parts come first, those with the same image together. @param {Surface | null} surface @param {number[]} numbers */
const order = (surface, numbers) => (surface ? numbers.indexOf(surface.image) : numbers.length);

/** Returns a material's base colour texture. @param {any} gltf @param {any} material @returns {Surface | null} */
function surfaceOf(gltf, material) {
  const info = material?.pbrMetallicRoughness?.baseColorTexture;
  const texture = gltf.textures?.[info?.index];
  const image = texture?.extensions?.EXT_texture_webp?.source ?? texture?.source;
  if (image === undefined) return null;
  const { offset: [u, v] = [0, 0], scale: [x, y] = [1, 1], rotation = 0, texCoord = info.texCoord ?? 0 } = info.extensions?.KHR_texture_transform ?? {};
  const [cos, sin] = [Math.cos(rotation), Math.sin(rotation)];
  const cutoff = material.alphaMode === "MASK" ? (material.alphaCutoff ?? 0.5) : material.alphaMode === "BLEND" ? BLENDED : 0;
  return { image, set: texCoord, transform: [x * cos, y * sin, u, -x * sin, y * cos, v], cutoff };
}

/** @param {any} gltf @param {Uint8Array<ArrayBuffer>} bin @param {number} number @returns {Picture | null} null if the image is not in the file */
function pictureOf(gltf, bin, number) {
  const { bufferView, mimeType: type } = gltf.images?.[number] ?? {};
  const view = gltf.bufferViews?.[bufferView];
  const start = view?.byteOffset ?? 0;
  if (!view || !type || view.buffer || view.extensions || start + view.byteLength > bin.length) return null;
  return { bytes: bin.subarray(start, start + view.byteLength), type };
}

/** @param {ArrayBuffer} buffer @returns {{gltf: any, bin: Uint8Array<ArrayBuffer>} | null} */
function chunks(buffer) {
  const view = new DataView(buffer);
  if (buffer.byteLength < 20 || view.getUint32(0, true) !== MAGIC || view.getUint32(4, true) !== 2) return null;
  /** @type {any} */
  let gltf = null;
  let bin = new Uint8Array();
  for (let at = 12; at + 8 <= buffer.byteLength; ) {
    const [size, kind] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
    if (at + 8 + size > buffer.byteLength) return null;
    const bytes = new Uint8Array(buffer, at + 8, size);
    if (kind === JSON_CHUNK && !gltf) gltf = JSON.parse(new TextDecoder().decode(bytes));
    if (kind === BIN_CHUNK && !bin.length) bin = bytes;
    at += 8 + size + ((4 - (size % 4)) % 4);
  }
  return gltf && { gltf, bin };
}

/** Lists the triangle primitives of the scene with their matrices, column by column. @param {any} gltf */
function instances(gltf) {
  /** @type {{primitive: any, matrix: number[]}[]} */
  const found = [];
  for (const { node, matrix } of placedNodes(gltf))
    for (const primitive of gltf.meshes?.[node.mesh]?.primitives ?? [])
      if ((primitive.mode ?? TRIANGLES) === TRIANGLES && primitive.attributes?.POSITION !== undefined) found.push({ primitive, matrix });
  return found;
}

/** @param {any} gltf @returns {{node: any, matrix: number[]}[]} the nodes of the default scene, with their matrices to world space */
function placedNodes(gltf) {
  /** @type {{node: any, matrix: number[]}[]} */
  const found = [];
  /** @param {number[]} numbers @param {number[]} parent @param {number} depth */
  const visit = (numbers, parent, depth) => {
    for (const number of numbers) {
      const node = gltf.nodes?.[number];
      if (!node || depth > MOST_DEPTH || found.length > MOST_INSTANCES) continue;
      const matrix = product(parent, node.matrix ?? fromParts(node));
      found.push({ node, matrix });
      visit(node.children ?? [], matrix, depth + 1);
    }
  };
  visit(gltf.scenes?.[gltf.scene ?? 0]?.nodes ?? [], [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1], 0);
  return found;
}

/** @param {{translation?: number[], rotation?: number[], scale?: number[]}} node @returns {number[]} */
function fromParts({ translation: [tx = 0, ty = 0, tz = 0] = [], rotation: [x = 0, y = 0, z = 0, w = 1] = [], scale: [sx = 1, sy = 1, sz = 1] = [] }) {
  return [
    ...[(1 - 2 * (y * y + z * z)) * sx, 2 * (x * y + z * w) * sx, 2 * (x * z - y * w) * sx, 0],
    ...[2 * (x * y - z * w) * sy, (1 - 2 * (x * x + z * z)) * sy, 2 * (y * z + x * w) * sy, 0],
    ...[2 * (x * z + y * w) * sz, 2 * (y * z - x * w) * sz, (1 - 2 * (x * x + y * y)) * sz, 0],
    ...[tx, ty, tz, 1],
  ];
}

/** @param {number[]} a @param {number[]} b @returns {number[]} */
function product(a, b) {
  return b.map((_, i) => [0, 1, 2, 3].reduce((sum, k) => sum + (a[4 * k + (i % 4)] ?? 0) * (b[4 * Math.floor(i / 4) + k] ?? 0), 0));
}

/** @param {any} gltf @param {any} primitive */
function triangleCount(gltf, { attributes, indices }) {
  return Math.floor((gltf.accessors?.[indices ?? attributes.POSITION]?.count ?? 0) / 3);
}

/** @param {any} gltf @param {Uint8Array} bin @param {any} primitive @param {number} share of the triangles to keep @param {Surface | null} surface @returns {Shape | null} */
function shapeOf(gltf, bin, primitive, share, surface) {
  const positions = floats(gltf, bin, primitive.attributes.POSITION, 3);
  if (!positions?.length) return null;
  const vertices = positions.length / 3;
  const own = primitive.attributes.NORMAL === undefined ? null : floats(gltf, bin, primitive.attributes.NORMAL, 3);
  const normals = own?.length === positions.length ? own : null;
  const uvs = surface && uvsOf(gltf, bin, primitive.attributes[`TEXCOORD_${surface.set}`], surface, vertices);
  const given = primitive.indices === undefined ? Uint32Array.from({ length: vertices }, (_, i) => i) : integers(gltf, bin, primitive.indices);
  if (!given || !isBelow(given, vertices)) return null;
  const indices = given.subarray(0, given.length - (given.length % 3));
  const target = Math.max(share * (indices.length / 3), FEWEST);
  /** @type {Shape} */
  let shape = { positions, normals, uvs, indices };
  const count = () => shape.indices.length / 3;
  // A flat grid of cells gives two triangles a cell, a closed surface several times as many.
  for (let cells = Math.sqrt(target / 2); count() > EXCESS * target && cells >= 2; cells *= 0.9 * Math.sqrt(target / count()))
    shape = clustered(positions, normals, uvs, indices, cells);
  return shape;
}

/** Returns a UV set, transformed; null if there is none of as many vertices. @param {any} gltf @param {Uint8Array} bin @param {number | undefined} number @param {Surface} surface @param {number} vertices */
function uvsOf(gltf, bin, number, { transform: [a = 1, b = 0, c = 0, d = 0, e = 1, f = 0] }, vertices) {
  const given = number === undefined ? null : floats(gltf, bin, number, 2);
  if (given?.length !== 2 * vertices) return null;
  const found = new Float32Array(2 * vertices);
  for (let i = 0; i < vertices; i++) {
    const u = given[2 * i] ?? 0;
    const v = given[2 * i + 1] ?? 0;
    found[2 * i] = a * u + b * v + c;
    found[2 * i + 1] = d * u + e * v + f;
  }
  return found;
}

/** Returns whether all indices are below a limit. @param {Uint32Array} indices @param {number} limit */
function isBelow(indices, limit) {
  for (const index of indices) if (index >= limit) return false;
  return true;
}

/** Reads an accessor. @param {any} gltf @param {Uint8Array} bin @param {number} number @param {number} width @returns {any} a typed array; null if absent or compressed */
function values(gltf, bin, number, width) {
  const accessor = gltf.accessors?.[number];
  const view = gltf.bufferViews?.[accessor?.bufferView];
  const component = COMPONENTS[accessor?.componentType];
  if (!view || !component || accessor.sparse || view.buffer || view.extensions || gltf.buffers?.[0]?.uri || WIDTHS[accessor.type] !== width) return null;
  const { array: Kind, size } = component;
  const step = view.byteStride || width * size;
  const start = bin.byteOffset + (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
  if (start + step * (accessor.count - 1) + width * size > bin.byteOffset + bin.byteLength) return null;
  if (step === width * size && start % size === 0) return new Kind(bin.buffer, start, accessor.count * width);
  const found = new Kind(accessor.count * width);
  const bytes = new Uint8Array(found.buffer);
  const source = new Uint8Array(bin.buffer);
  for (let i = 0; i < accessor.count; i++) bytes.set(source.subarray(start + i * step, start + i * step + width * size), i * width * size);
  return found;
}

/** @param {any} gltf @param {Uint8Array} bin @param {number} number @param {number} width @returns {Float32Array | null} */
function floats(gltf, bin, number, width) {
  const found = values(gltf, bin, number, width);
  if (!found || found instanceof Float32Array) return found;
  const { componentType, normalized } = gltf.accessors[number];
  const unit = normalized ? (COMPONENTS[componentType]?.unit ?? 1) : 1;
  return Float32Array.from(found, (value) => Math.max(value / unit, normalized ? -1 : -Infinity));
}

/** @param {any} gltf @param {Uint8Array} bin @param {number} number @returns {Uint32Array | null} */
function integers(gltf, bin, number) {
  const found = values(gltf, bin, number, 1);
  return !found || found instanceof Uint32Array ? found : Uint32Array.from(found);
}

/**
 * Decimates: replaces all vertices in a cell of a grid by one of them (Rossignac and Borrel 1993), as renderer/scene/preview.py does.
 *
 * @param {Float32Array} positions
 * @param {Float32Array | null} normals
 * @param {Float32Array | null} uvs
 * @param {Uint32Array} indices
 * @param {number} cells along the longest side
 * @returns {Shape}
 */
function clustered(positions, normals, uvs, indices, cells) {
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
  let length = 0;
  for (let i = 0; i < indices.length; i += 3) {
    const a = keptOf[indices[i] ?? 0] ?? 0;
    const b = keptOf[indices[i + 1] ?? 0] ?? 0;
    const c = keptOf[indices[i + 2] ?? 0] ?? 0;
    if (a === b || b === c || c === a) continue;
    corners[length++] = a;
    corners[length++] = b;
    corners[length++] = c;
  }
  /** @param {Float32Array} source @param {number} width */
  const picked = (source, width) => {
    const found = new Float32Array(width * count);
    for (let i = 0; i < count; i++) {
      const at = width * (kept[i] ?? 0);
      for (let k = 0; k < width; k++) found[width * i + k] = source[at + k] ?? 0;
    }
    return found;
  };
  return { positions: picked(positions, 3), normals: normals && picked(normals, 3), uvs: uvs && picked(uvs, 2), indices: corners.slice(0, length) };
}

/** @param {Float32Array | Float64Array} positions @returns {{low: Vec3, high: Vec3}} */
function boundsOf(positions) {
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

/** Returns a material's base colour, or what it emits: sRGB, and 255 or 0, unshaded. @param {any} material @returns {number[]} */
function colorOf(material) {
  const emitted = /** @type {number[]} */ (material?.emissiveFactor ?? [0, 0, 0]);
  const isUnshaded = Boolean(material?.extensions?.KHR_materials_unlit) || (Math.max(...emitted) > 0 && !material.emissiveTexture);
  const base = /** @type {number[]} */ (material?.pbrMetallicRoughness?.baseColorFactor ?? [1, 1, 1, 1]);
  const linear = Math.max(...emitted) > 0 && !material.emissiveTexture ? emitted : base;
  const coded = linear.slice(0, 3).map((value) => Math.round(255 * encoded(Math.min(Math.max(value, 0), 1))));
  return [...coded, isUnshaded ? 0 : 255];
}

/** sRGB's transfer function. @param {number} value */
const encoded = (value) => (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055);

/**
 * Joins shapes in world space.
 *
 * @param {Drawn[]} drawn those with the same image together
 * @param {any} gltf
 * @param {number[]} images those that are used
 * @returns {{packet: MeshPacket, view: View} | null}
 */
function joined(drawn, gltf, images) {
  const vertices = drawn.reduce((sum, { shape }) => sum + shape.positions.length / 3, 0);
  const corners = drawn.reduce((sum, { shape }) => sum + shape.indices.length, 0);
  const places = new Float64Array(3 * vertices);
  const normals = new Int8Array(4 * vertices);
  const colors = new Uint8Array(4 * vertices);
  const indices = new Uint32Array(corners);
  const uvs = images.length ? new Float32Array(2 * vertices) : undefined;
  /** @type {import("./mesh-packet.js").MeshPart[]} */
  const parts = [];
  let [vertex, corner] = [0, 0];
  for (const { shape, matrix, color, surface } of drawn) {
    const [a = 0, b = 0, c = 0, , d = 0, e = 0, f = 0, , g = 0, h = 0, i = 0, , tx = 0, ty = 0, tz = 0] = matrix;
    // The cofactors of the matrix, which turn normals.
    const [n0, n1, n2, n3, n4, n5, n6, n7, n8] = [e * i - f * h, f * g - d * i, d * h - e * g, c * h - b * i, a * i - c * g, b * g - a * h, b * f - c * e, c * d - a * f, a * e - b * d];
    const first = vertex;
    const { positions, normals: own } = shape;
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
    }
    if (surface && shape.uvs) uvs?.set(shape.uvs, 2 * first);
    const [texture, cutoff] = surface ? [images.indexOf(surface.image), surface.cutoff] : [-1, 0];
    const last = parts.at(-1);
    if (last?.texture === texture && last.cutoff === cutoff) last.count += shape.indices.length;
    else parts.push({ texture, cutoff, first: corner, count: shape.indices.length });
    for (const index of shape.indices) indices[corner++] = first + index;
  }
  const { low, high } = boundsOf(places);
  if (![...low, ...high].every(Number.isFinite)) return null;
  const positions = new Uint16Array(4 * vertices);
  const scale = low.map((value, axis) => STEPS / ((high[axis] ?? 0) - value || 1));
  for (let k = 0; k < vertices; k++)
    for (let axis = 0; axis < 3; axis++) positions[4 * k + axis] = Math.round(((places[3 * k + axis] ?? 0) - (low[axis] ?? 0)) * (scale[axis] ?? 0));
  const isLit = (gltf.extensions?.KHR_lights_punctual?.lights ?? []).length > 0; // in a black world
  const background = isLit ? /** @type {Vec3} */ ([0, 0, 0]) : null;
  const packet = { vertices, triangles: corners / 3, low, high, background, positions, normals, colors, indices, ...(uvs && { uvs, parts }) };
  return { packet, view: fileCamera(gltf, low, high) ?? frame(places) };
}

/** Returns the view through the file's first perspective camera. @param {any} gltf @param {Vec3} low @param {Vec3} high @returns {View | null} */
function fileCamera(gltf, low, high) {
  for (const { node, matrix: m } of placedNodes(gltf)) {
    const lens = gltf.cameras?.[node.camera]?.perspective;
    if (!lens) continue;
    const column = (/** @type {number} */ first) => /** @type {Vec3} */ ([m[first] ?? 0, m[first + 1] ?? 0, m[first + 2] ?? 0]);
    const [up, back, eye] = [column(4), column(8), column(12)];
    const size = Math.hypot(...back) || 1;
    // The target is as far as the middle of the scene, as the view turns about it.
    const middle = eye.reduce((sum, value, i) => sum + ((value - ((low[i] ?? 0) + (high[i] ?? 0)) / 2) * (back[i] ?? 0)) / size, 0);
    const away = middle > 0 ? middle : 1;
    return { eye, target: /** @type {Vec3} */ (eye.map((value, i) => value - (away * (back[i] ?? 0)) / size)), up, fov: (lens.yfov * 180) / Math.PI };
  }
  return null;
}

/** Returns the view that the service's automatic camera has. @param {Float64Array} places @returns {View} */
export function frame(places) {
  const length = Math.hypot(1, 0.62, 0.42);
  /** @type {Vec3} */
  const back = [0.62 / length, 0.42 / length, 1 / length];
  const flat = Math.hypot(back[0], back[2]);
  /** @type {Vec3} */
  const right = [back[2] / flat, 0, -back[0] / flat];
  /** @type {Vec3} */
  const above = [back[1] * right[2] - back[2] * right[1], back[2] * right[0] - back[0] * right[2], back[0] * right[1] - back[1] * right[0]];
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
  const point = (/** @type {number} */ depth) => /** @type {Vec3} */ ([0, 1, 2].map((i) => (at[0] ?? 0) * (right[i] ?? 0) + (at[1] ?? 0) * (above[i] ?? 0) + depth * (back[i] ?? 0)));
  return { eye: point(away), target: point((nearest + farthest) / 2), up: [0, 1, 0], fov: FOV };
}
