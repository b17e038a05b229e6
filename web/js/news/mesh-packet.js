/** A scene's preview mesh: what is drawn until there are path-traced samples, read by this page or by the service (protocol/mesh.py). */

import { MESH_HEAD_BYTES, decodeMeshHead } from "../base/protocol.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */

/**
 * @typedef {object} MeshPacket
 * @property {number} vertices
 * @property {number} triangles
 * @property {Vec3} low lower corner of the mesh
 * @property {Vec3} high
 * @property {Uint16Array} positions four a vertex: three 65535ths of the way between the corners, and 0
 * @property {Int8Array} normals four a vertex: three 127ths, and 0; all 0: flat shading
 * @property {Uint8Array} colors four a vertex: sRGB, and opacity
 * @property {Uint32Array} indices three a triangle
 * @property {Float32Array} [uvs] two a vertex; absent: no textures
 * @property {MeshPart[]} parts all triangles
 * @property {MeshMaterial[]} materials
 * @property {MeshTexture[]} textures
 * @property {Lamp[]} lamps
 * @property {Environment | null} environment null: black, or the studio
 * @property {boolean} isStudio whether it is the light that scenes without lights are given
 */

/** Equirectangular radiance as RGB9E5, rows from the top. The middle column is towards -Z. @typedef {{width: number, height: number, words: Uint32Array}} Environment */

/**
 * A lamp. at: its place, or if it is far away the direction to it. color: radiance that it gives a white surface at the middle of the
 * scene, or if it is relative, in proportion to that of the others. axis: the direction in which it shines; its light falls off linearly
 * from the inner to the outer cosine, which are `cosines` from the outer one.
 *
 * @typedef {{at: Vec3, far: boolean, color: Vec3, axis: Vec3, cosines: [number, number], isRelative?: boolean}} Lamp
 */

/** A range of `indices`, and the number of its material. @typedef {{first: number, corners: number, material: number}} MeshPart */

/**
 * A surface, as PreviewMaterial (renderer/preview_mesh.py); its base colour is that of the vertices. Textures are numbers, -1: none.
 *
 * @typedef {object} MeshMaterial
 * @property {number} metallic
 * @property {number} roughness
 * @property {Vec3} f0 reflectance at normal incidence of what is no metal
 * @property {number} transmission
 * @property {number} ior
 * @property {boolean} thin
 * @property {number} coat
 * @property {number} coat_roughness
 * @property {Vec3} emission radiance
 * @property {boolean} unlit
 * @property {"opaque" | "mask" | "blend"} alpha_mode
 * @property {number} cutoff
 * @property {number} texture
 * @property {number} metallic_roughness_texture
 * @property {number} emission_texture
 */

/** @typedef {"repeat" | "mirror" | "clamp"} Wrap */
/** How a texture is read between and beyond its texels. @typedef {{wrap_s: Wrap, wrap_t: Wrap, nearest: boolean}} Sampler */
/** A texture. image: null: it cannot be shown. @typedef {{sampler: Sampler, image: Promise<ImageBitmap | null>}} MeshTexture */

const BOUNDS_BYTES = 48;

/**
 * Returns the offsets of the sections of a packet, and of its end without the textures.
 *
 * @param {DataView} view of at least the packet's first HEAD_BYTES
 */
function layoutOf(view) {
  const { width, height, studio, vertices, triangles, uvs, described } = decodeMeshHead(view);
  const positions = MESH_HEAD_BYTES + BOUNDS_BYTES;
  const normals = positions + 8 * vertices;
  const colors = normals + 4 * vertices;
  const coordinates = colors + 4 * vertices;
  const indices = coordinates + 8 * uvs;
  const texels = indices + 12 * triangles;
  const json = texels + 4 * width * height;
  return { width, height, isStudio: studio === 1, vertices, triangles, uvs, positions, normals, colors, coordinates, indices, texels, json, end: json + described };
}

/** Returns how many bytes of a packet are before its textures. @param {Uint8Array<ArrayBuffer>} bytes the first HEAD_BYTES of it, or more */
const lengthWithoutTextures = ({ buffer }) => layoutOf(new DataView(buffer)).end;

export const HEAD_BYTES = MESH_HEAD_BYTES + BOUNDS_BYTES;

/**
 * @param {ArrayBuffer} buffer a packet, or its part before the textures
 * @param {(start: number, end: number, type: string) => Promise<ImageBitmap | null>} image reads the image file at these offsets
 * @returns {MeshPacket}
 */
export function decodeMesh(buffer, image) {
  const view = new DataView(buffer);
  const { vertices, triangles, uvs, width, height, isStudio, ...at } = layoutOf(view);
  if (buffer.byteLength < at.end) throw new Error(`A mesh of ${vertices} vertices and ${triangles} triangles came with ${buffer.byteLength} bytes.`);
  const corner = (/** @type {number} */ first) => /** @type {Vec3} */ ([0, 1, 2].map((i) => view.getFloat64(MESH_HEAD_BYTES + 8 * (first + i), true)));
  const { parts, materials, textures, lamps } = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, at.json, at.end - at.json)));
  let start = at.end;
  return {
    ...{ vertices, triangles, low: corner(0), high: corner(3), parts, materials, lamps, isStudio },
    positions: new Uint16Array(buffer, at.positions, 4 * vertices),
    normals: new Int8Array(buffer, at.normals, 4 * vertices),
    colors: new Uint8Array(buffer, at.colors, 4 * vertices),
    ...(uvs && { uvs: new Float32Array(buffer, at.coordinates, 2 * vertices) }),
    indices: new Uint32Array(buffer, at.indices, 3 * triangles),
    environment: height ? { width, height, words: new Uint32Array(buffer, at.texels, width * height) } : null,
    textures: textures.map((/** @type {{bytes: number, sampler: Sampler & {type: string}}} */ { bytes, sampler: { type, ...sampler } }) => ({ sampler, image: image(start, (start += bytes), type) })),
  };
}

/**
 * Reads a packet while it arrives. Resolves with the triangles; the promises of the textures resolve later.
 *
 * @param {ReadableStream<Uint8Array>} body
 * @returns {Promise<MeshPacket>}
 */
export async function readMesh(body) {
  const reader = body.getReader();
  let bytes = new Uint8Array(1 << 20);
  let filled = 0;
  /** Reads until at least `end` bytes have arrived. @param {number} end */
  const readTo = async (end) => {
    while (filled < end) {
      const { done, value } = await reader.read();
      if (done) throw new Error(`A mesh came with ${filled} bytes.`);
      if (filled + value.length > bytes.length) {
        const larger = new Uint8Array(Math.max(2 * bytes.length, filled + value.length, end));
        larger.set(bytes.subarray(0, filled));
        bytes = larger;
      }
      bytes.set(value, filled);
      filled += value.length;
    }
  };
  await readTo(HEAD_BYTES);
  const end = lengthWithoutTextures(bytes);
  await readTo(end);
  let before = Promise.resolve();
  return decodeMesh(bytes.buffer.slice(0, end), (start, to, type) => {
    const arrived = before.then(() => readTo(to));
    before = arrived.catch(() => {});
    return arrived.then(() => createImageBitmap(new Blob([bytes.slice(start, to)], { type }), { premultiplyAlpha: "none", colorSpaceConversion: "none" })).catch(() => null);
  });
}
