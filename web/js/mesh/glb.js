/**
 * Reads glTF files in the browser as far as a preview needs: triangles with normals, materials and textures.
 *
 * The service's preview mesh (renderer/scene/preview.py), which is finer, replaces it if the file has no textures, or has what is not
 * read here, such as poses.
 */

import { MOST_TRIANGLES, decimated, orbitView } from "./shapes.js";
import { pictureType } from "./files.js";
import { IDENTITY, product } from "./matrix.js";
import { coded, isBelow, viewed } from "./model.js";
import { MATT, NO_TEXTURE, OMNI, Pictures, dielectric } from "./surface.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("./shapes.js").Drawn} Drawn */
/** @typedef {import("./shapes.js").LocalMesh} LocalMesh */
/** @typedef {import("./shapes.js").Picture} Picture */
/** @typedef {import("./shapes.js").Shape} Shape */

const MOST_INSTANCES = 20_000;
const MOST_DEPTH = 64;

const MAGIC = 0x46546c67;
const JSON_CHUNK = 0x4e4f534a;
const BIN_CHUNK = 0x004e4942;
const TRIANGLES = 4;

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

/** A texture: its number, its image, and the UV set and transform (a, b, c, d, e, f). @typedef {{number: number, image: number, set: number, transform: number[]}} Surface */

/**
 * @param {Uint8Array<ArrayBuffer>} file
 * @param {number} [most] triangles, about
 * @returns {LocalMesh | null} null if the file is malformed, has no triangles, or is compressed
 */
export function readGlb(file, most = MOST_TRIANGLES) {
  const parts = chunks(file);
  return parts && meshOf(parts.gltf, parts.bin, new Map(), most);
}

/**
 * Reads a .gltf file with its buffer and images.
 *
 * @param {Uint8Array<ArrayBuffer>} file
 * @param {(reference: string) => Promise<Uint8Array<ArrayBuffer> | null>} read returns the contents of a file that this one names
 * @returns {Promise<LocalMesh | null>} null also if the file has several buffers
 */
export async function readGltf(file, read) {
  const gltf = JSON.parse(new TextDecoder().decode(file));
  const [buffer, ...others] = gltf.buffers ?? [];
  if (!buffer?.uri || others.length) return null;
  const content = (/** @type {string} */ uri) => (uri.startsWith("data:") ? fromDataUrl(uri) : read(decodeURIComponent(uri)));
  const bin = await content(buffer.uri);
  if (!bin) return null;
  delete buffer.uri;
  /** @type {Map<number, Picture>} */
  const beside = new Map();
  for (const [number, { uri, mimeType }] of (gltf.images ?? []).entries()) {
    const bytes = uri ? await content(uri) : null;
    if (bytes) beside.set(number, { bytes, type: mimeType ?? pictureType(uri) });
  }
  return meshOf(gltf, bin, beside, MOST_TRIANGLES);
}

/** @param {string} url @returns {Uint8Array<ArrayBuffer> | null} the bytes of a data URL in base64 */
function fromDataUrl(url) {
  const at = url.indexOf(";base64,");
  return at < 0 ? null : Uint8Array.from(atob(url.slice(at + 8)), (character) => character.charCodeAt(0));
}

/**
 * @param {any} gltf
 * @param {Uint8Array<ArrayBuffer>} bin its buffer
 * @param {Map<number, Picture>} beside images in files of their own
 * @param {number} most triangles, about
 * @returns {LocalMesh | null}
 */
function meshOf(gltf, bin, beside, most) {
  const all = instances(gltf);
  const placed = all.slice(0, MOST_INSTANCES);
  const total = placed.reduce((sum, { primitive }) => sum + triangleCount(gltf, primitive), 0);
  if (!total) return null;
  const share = Math.min(1, most / total);
  /** @type {Map<object, Shape | null>} */
  const shapes = new Map();
  /** @type {Drawn[]} */
  const drawn = [];
  const pictures = new Pictures();
  /** @type {Map<number, Picture | null>} by the numbers of textures */
  const read = new Map();
  let isTextured = true; // KTX2 and others are read by the service alone
  /** @param {Surface | null} surface */
  const numberOf = (surface) => {
    if (!surface) return NO_TEXTURE;
    const { number, image } = surface;
    if (!read.has(number)) {
      const found = beside.get(image) ?? pictureOf(gltf, bin, image);
      read.set(number, found && { ...found, sampler: samplerOf(gltf, number) });
    }
    return pictures.numberOf(read.get(number));
  };
  for (const { primitive, matrix } of placed) {
    const source = gltf.materials?.[primitive.material];
    const { base, others } = surfacesOf(gltf, source);
    if (!shapes.has(primitive)) shapes.set(primitive, shapeOf(gltf, bin, primitive, share, base ?? others.find(([, surface]) => surface)?.[1] ?? null));
    const shape = shapes.get(primitive);
    if (!shape) continue;
    const material = materialOf(source);
    if (shape.uvs) {
      material.texture = numberOf(base);
      for (const [slot, surface] of others) material[slot] = numberOf(surface);
    }
    const lacksTexture = material.texture === NO_TEXTURE && source?.pbrMetallicRoughness?.baseColorTexture;
    isTextured &&= !lacksTexture && !source?.extensions?.KHR_materials_pbrSpecularGlossiness;
    drawn.push({ shape, matrix, color: colorOf(source), material });
  }
  if (!drawn.length) return null;
  const lamps = lampsOf(gltf);
  const found = viewed(drawn, lamps, (low, high) => fileCamera(gltf, low, high));
  if (!found) return null;
  const { packet, view, hasAllMaterials } = found;
  if (lamps.length) packet.lamps = lamps.map((lamp) => fromMiddle(lamp, packet.low, packet.high));
  const hasPanes = packet.materials.some(({ transmission, thin }) => transmission > 0 && thin); // the service looks whether they are closed, and so filled
  const isPosed = (gltf.nodes ?? []).some((/** @type {any} */ node) => node.skin !== undefined || node.weights);
  const isWhole = isTextured && hasAllMaterials && !hasPanes && drawn.length === all.length && !isPosed && !gltf.extensions?.KHR_materials_variants;
  return { packet, view, isWhole, images: pictures.all };
}

const WRAPS = /** @type {Record<number, import("../news/mesh-packet.js").Wrap>} */ ({ 33071: "clamp", 33648: "mirror" });
const NEAREST = 9728;

/** @param {any} gltf @param {number} texture @returns {import("../news/mesh-packet.js").Sampler} */
function samplerOf(gltf, texture) {
  const { wrapS = 0, wrapT = 0, magFilter } = gltf.samplers?.[gltf.textures[texture].sampler] ?? {};
  return { wrap_s: WRAPS[wrapS] ?? "repeat", wrap_t: WRAPS[wrapT] ?? "repeat", nearest: magFilter === NEAREST };
}

/**
 * Returns a material's base colour texture, and those of its others that have the same UVs.
 *
 * @param {any} gltf
 * @param {any} material
 * @returns {{base: Surface | null, others: ["metallic_roughness_texture" | "emission_texture", Surface | null][]}}
 */
function surfacesOf(gltf, material) {
  const metallic = material?.pbrMetallicRoughness ?? {};
  const base = surfaceOf(gltf, metallic.baseColorTexture);
  const rough = surfaceOf(gltf, metallic.metallicRoughnessTexture);
  const emission = Math.max(...(material?.emissiveFactor ?? [0])) > 0 ? surfaceOf(gltf, material.emissiveTexture) : null;
  const first = base ?? rough ?? emission;
  const isAlike = (/** @type {Surface | null} */ each) => each?.set === first?.set && each?.transform.join() === first?.transform.join();
  return {
    base,
    others: [
      ["metallic_roughness_texture", isAlike(rough) ? rough : null],
      ["emission_texture", isAlike(emission) ? emission : null],
    ],
  };
}

/** Returns a material without its textures. @param {any} source @returns {import("../news/mesh-packet.js").MeshMaterial} */
function materialOf(source) {
  const { metallicFactor = 1, roughnessFactor = 1 } = source?.pbrMetallicRoughness ?? {};
  const extension = (/** @type {string} */ name) => source?.extensions?.[`KHR_materials_${name}`] ?? {};
  const { ior = 1.5 } = extension("ior");
  const { specularFactor = 1, specularColorFactor } = extension("specular");
  const { clearcoatFactor = 0, clearcoatRoughnessFactor = 0 } = extension("clearcoat");
  const { emissiveStrength = 1 } = extension("emissive_strength");
  const isUnlit = Boolean(source?.extensions?.KHR_materials_unlit);
  const emission = /** @type {Vec3} */ ((source?.emissiveFactor ?? [0, 0, 0]).map((/** @type {number} */ value) => (isUnlit ? 0 : value * emissiveStrength)));
  const modes = /** @type {Record<string, "mask" | "blend">} */ ({ MASK: "mask", BLEND: "blend" });
  return {
    ...MATT,
    ...{ metallic: metallicFactor, roughness: roughnessFactor, ior, f0: dielectric(ior, specularColorFactor, specularFactor) },
    ...{ transmission: extension("transmission").transmissionFactor ?? 0, thin: !((extension("volume").thicknessFactor ?? 0) > 0) },
    ...{ coat: clearcoatFactor, coat_roughness: clearcoatRoughnessFactor, emission, unlit: isUnlit },
    ...{ alpha_mode: modes[source?.alphaMode] ?? "opaque", cutoff: source?.alphaCutoff ?? 0.5 },
  };
}

/** @param {any} gltf @param {any} info a material's reference to a texture @returns {Surface | null} */
function surfaceOf(gltf, info) {
  const texture = gltf.textures?.[info?.index];
  const image = texture?.extensions?.EXT_texture_webp?.source ?? texture?.source;
  if (image === undefined) return null;
  const { offset: [u, v] = [0, 0], scale: [x, y] = [1, 1], rotation = 0, texCoord = info.texCoord ?? 0 } = info.extensions?.KHR_texture_transform ?? {};
  const [cos, sin] = [Math.cos(rotation), Math.sin(rotation)];
  return { number: info.index, image, set: texCoord, transform: [x * cos, y * sin, u, -x * sin, y * cos, v] };
}

/** @param {any} gltf @param {Uint8Array<ArrayBuffer>} bin @param {number} number @returns {Picture | null} null if the image is not in the file */
function pictureOf(gltf, bin, number) {
  const { bufferView, mimeType: type } = gltf.images?.[number] ?? {};
  const view = gltf.bufferViews?.[bufferView];
  const start = view?.byteOffset ?? 0;
  if (!view || !type || view.buffer || view.extensions || start + view.byteLength > bin.length) return null;
  return { bytes: bin.subarray(start, start + view.byteLength), type };
}

/** @param {Uint8Array<ArrayBuffer>} file @returns {{gltf: any, bin: Uint8Array<ArrayBuffer>} | null} */
function chunks({ buffer, byteOffset, byteLength }) {
  const view = new DataView(buffer, byteOffset, byteLength);
  if (byteLength < 20 || view.getUint32(0, true) !== MAGIC || view.getUint32(4, true) !== 2) return null;
  /** @type {any} */
  let gltf = null;
  let bin = new Uint8Array();
  for (let at = 12; at + 8 <= byteLength; ) {
    const [size, kind] = [view.getUint32(at, true), view.getUint32(at + 4, true)];
    if (at + 8 + size > byteLength) return null;
    const bytes = new Uint8Array(buffer, byteOffset + at + 8, size);
    if (kind === JSON_CHUNK && !gltf) gltf = JSON.parse(new TextDecoder().decode(bytes));
    if (kind === BIN_CHUNK && !bin.length) bin = bytes;
    at += 8 + size + ((4 - (size % 4)) % 4);
  }
  return gltf && { gltf, bin };
}

/** Lists the triangle primitives of the scene with their matrices, column by column, up to one more than are drawn. @param {any} gltf */
function instances(gltf) {
  /** @type {{primitive: any, matrix: number[]}[]} */
  const found = [];
  for (const { node, matrix } of placedNodes(gltf))
    for (const primitive of gltf.meshes?.[node.mesh]?.primitives ?? []) {
      if (found.length > MOST_INSTANCES) return found;
      if ((primitive.mode ?? TRIANGLES) === TRIANGLES && primitive.attributes?.POSITION !== undefined) found.push({ primitive, matrix });
    }
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
  visit(gltf.scenes?.[gltf.scene ?? 0]?.nodes ?? [], IDENTITY, 0);
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
  return decimated({ positions, normals, uvs, indices }, share);
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

/** Reads an accessor. @param {any} gltf @param {Uint8Array} bin @param {number} number @param {number} width @returns {any} a typed array; null if absent or compressed */
function values(gltf, bin, number, width) {
  const accessor = gltf.accessors?.[number];
  const view = gltf.bufferViews?.[accessor?.bufferView];
  const component = COMPONENTS[accessor?.componentType];
  if (!view || !component || accessor.sparse || view.buffer || view.extensions || gltf.buffers?.[0]?.uri || WIDTHS[accessor.type] !== width) return null;
  const { array: Kind, size } = component;
  const step = view.byteStride || width * size;
  const start = bin.byteOffset + (view.byteOffset ?? 0) + (accessor.byteOffset ?? 0);
  if (!(step >= width * size) || start + step * (accessor.count - 1) + width * size > bin.byteOffset + bin.byteLength) return null;
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

/** Returns a material's base colour in sRGB, and its opacity, from 0 to 255. @param {any} material @returns {number[]} */
function colorOf(material) {
  const [red, green, blue, opacity] = /** @type {number[]} */ (material?.pbrMetallicRoughness?.baseColorFactor ?? [1, 1, 1, 1]);
  return [...coded([red ?? 1, green ?? 1, blue ?? 1]), Math.round(255 * (opacity ?? 1))];
}

/** Whether a light is not black. @param {{color?: number[], intensity?: number}} light */
const shines = ({ color = [1, 1, 1], intensity = 1 }) => intensity * Math.max(...color) > 0;

/** Returns the file's lamps, spots like points, with their intensities in proportion: the service converts their units. @param {any} gltf @returns {import("./shapes.js").Lamp[]} */
function lampsOf(gltf) {
  return placedNodes(gltf).flatMap(({ node, matrix: m }) => {
    const light = gltf.extensions?.KHR_lights_punctual?.lights?.[node.extensions?.KHR_lights_punctual?.light];
    if (!light || !shines(light)) return [];
    const isFar = light.type === "directional";
    const at = /** @type {Vec3} */ ((isFar ? [8, 9, 10] : [12, 13, 14]).map((i) => m[i] ?? 0));
    const { color = [1, 1, 1], intensity = 1 } = light;
    return [{ ...OMNI, at, far: isFar, color: /** @type {Vec3} */ (color.map((/** @type {number} */ value) => value * intensity)), isRelative: true }];
  });
}

/** Returns a lamp whose colour is the radiance that it gives the middle of the scene, in place of its intensity. @param {import("./shapes.js").Lamp} lamp @param {Vec3} low @param {Vec3} high */
function fromMiddle(lamp, low, high) {
  const away = lamp.far ? 1 : Math.hypot(...lamp.at.map((value, i) => value - ((low[i] ?? 0) + (high[i] ?? 0)) / 2)) || 1;
  return { ...lamp, color: /** @type {Vec3} */ (lamp.color.map((value) => value / away ** 2)) };
}

/** Returns the view through the file's first perspective camera. @param {any} gltf @param {Vec3} low @param {Vec3} high @returns {View | null} */
function fileCamera(gltf, low, high) {
  for (const { node, matrix: m } of placedNodes(gltf)) {
    const lens = gltf.cameras?.[node.camera]?.perspective;
    if (!lens) continue;
    const column = (/** @type {number} */ first) => /** @type {Vec3} */ ([m[first] ?? 0, m[first + 1] ?? 0, m[first + 2] ?? 0]);
    const [up, back, eye] = [column(4), column(8), column(12)];
    return orbitView(eye, back, up, (lens.yfov * 180) / Math.PI, low, high);
  }
  return null;
}
