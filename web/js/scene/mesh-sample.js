/** A triangle of a plain material in the studio, by which programs are compiled before a mesh is here. */

/** @type {import("../news/mesh-packet.js").MeshMaterial} */
const MATERIAL = {
  metallic: 0,
  roughness: 0.5,
  f0: [0.04, 0.04, 0.04],
  transmission: 0,
  ior: 1.5,
  thin: false,
  coat: 0,
  coat_roughness: 0,
  emission: [0, 0, 0],
  unlit: false,
  alpha_mode: "opaque",
  cutoff: 0.5,
  texture: -1,
  metallic_roughness_texture: -1,
  emission_texture: -1,
};

/** @type {import("../news/mesh-packet.js").MeshPacket} */
export const SAMPLE = {
  vertices: 3,
  triangles: 1,
  low: [0, 0, 0],
  high: [1, 1, 1],
  positions: new Uint16Array([0, 0, 0, 0, 65535, 0, 0, 0, 0, 65535, 0, 0]),
  normals: new Int8Array([0, 0, 127, 0, 0, 0, 127, 0, 0, 0, 127, 0]),
  colors: new Uint8Array(12).fill(255),
  uvs: new Float32Array(6),
  indices: new Uint32Array([0, 1, 2]),
  parts: [{ first: 0, corners: 3, material: 0 }],
  materials: [MATERIAL],
  textures: [],
  lamps: [],
  environment: null,
  isStudio: true,
};

/** The same with a lamp. @type {import("../news/mesh-packet.js").MeshPacket} */
export const LIT_SAMPLE = { ...SAMPLE, lamps: [{ at: [1, 1, 2], far: false, color: [1, 1, 1], axis: [0, 0, -1], cosines: [-2, -1] }] };

/** @type {import("../base/types.js").View} */
export const SAMPLE_VIEW = { eye: [0, 0, 3], target: [0, 0, 0], up: [0, 1, 0], fov: 40 };
