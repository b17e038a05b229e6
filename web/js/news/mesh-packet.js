/** A scene's preview mesh as the service sends it; protocol/mesh.py declares its layout. */

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
 * @property {Uint8Array} colors four a vertex: sRGB, and 255; 0: unshaded
 * @property {Uint32Array} indices three a triangle
 * @property {Vec3 | null} background of the world, sRGB from 0 to 255; null: the studio, which lights the scene, or not known
 * @property {Float32Array} [uvs] two a vertex; absent: no textures
 * @property {MeshPart[]} [parts] all triangles, with the textures that `uvs` are for
 * @property {Promise<ImageBitmap | null>[]} [textures] by number; null: it cannot be shown
 * @property {Lamp[]} [lamps] absent: not known
 */

/** A lamp. at: its place, or if it is far away the direction to it; color: linear, its irradiance at the middle of the scene in proportion to that of the others. @typedef {{at: Vec3, isFar: boolean, color: Vec3}} Lamp */

/** A range of `indices`, its texture (-1: none), and the alpha below which nothing is seen. @typedef {{first: number, count: number, texture: number, cutoff: number}} MeshPart */

const BOUNDS_BYTES = 48;

/**
 * @param {ArrayBuffer} buffer
 * @returns {MeshPacket}
 */
export function decodeMesh(buffer) {
  const view = new DataView(buffer);
  const { vertices, triangles, background } = decodeMeshHead(view);
  const at = MESH_HEAD_BYTES + BOUNDS_BYTES;
  if (buffer.byteLength !== at + 16 * vertices + 12 * triangles)
    throw new Error(`A mesh of ${vertices} vertices and ${triangles} triangles came with ${buffer.byteLength} bytes.`);
  const corner = (/** @type {number} */ first) =>
    /** @type {Vec3} */ ([0, 1, 2].map((i) => view.getFloat64(MESH_HEAD_BYTES + 8 * (first + i), true)));
  return {
    ...{ vertices, triangles, low: corner(0), high: corner(3) },
    background: background ? /** @type {Vec3} */ ([11, 6, 1].map((shift) => ((background >> shift) & 31) << 3)) : null,
    positions: new Uint16Array(buffer, at, 4 * vertices),
    normals: new Int8Array(buffer, at + 8 * vertices, 4 * vertices),
    colors: new Uint8Array(buffer, at + 12 * vertices, 4 * vertices),
    indices: new Uint32Array(buffer, at + 16 * vertices, 3 * triangles),
  };
}
