/** The textures of a preview mesh on the graphics card: those of materials as their images arrive, and the light around. */

import { lightTables } from "./mesh-environment.js";

/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/** @typedef {import("../news/mesh-packet.js").Wrap} Wrap */

const MOST_ANISOTROPY = 4;

/** Texels, linear and with opacity: one that changes nothing, and those of images that are awaited. @typedef {[number, number, number, number]} Texel */
const WHITE = /** @type {Texel} */ ([255, 255, 255, 255]);
const GREY = /** @type {Texel} */ ([90, 90, 90, 255]);
const HALF = /** @type {Texel} */ ([90, 90, 90, 128]);
const BLACK = /** @type {Texel} */ ([0, 0, 0, 255]);

/** @param {WebGL2RenderingContext} gl @param {Texel} [texel] @returns {WebGLTexture} one texel, bound to the active unit */
export function texelTexture(gl, texel) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  fillTexel(gl, texture, texel);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  return texture;
}

/** @param {WebGL2RenderingContext} gl @param {WebGLTexture | null} texture @param {Texel} [texel] */
export function fillTexel(gl, texture, texel = WHITE) {
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(texel));
}

/** Returns what stands in for a texture whose image has not arrived: no colour is far from a middle grey. @param {number} number @param {import("../news/mesh-packet.js").MeshMaterial[]} materials @returns {Texel} */
export function standInOf(number, materials) {
  const colored = materials.filter(({ texture }) => texture === number);
  if (colored.length) return colored.every(({ alpha_mode: mode }) => mode === "blend") ? HALF : GREY;
  return materials.some(({ emission_texture: glow }) => glow === number) ? BLACK : WHITE;
}

/**
 * Fills a texture of a mesh.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {WebGLTexture | null} texture
 * @param {ImageBitmap} image
 * @param {import("../news/mesh-packet.js").Sampler} sampler
 * @param {boolean} isData whether its values are no colours
 */
export function fillTexture(gl, texture, image, { wrap_s: wrapS, wrap_t: wrapT, nearest }, isData) {
  const wraps = /** @type {Record<Wrap, number>} */ ({ repeat: gl.REPEAT, mirror: gl.MIRRORED_REPEAT, clamp: gl.CLAMP_TO_EDGE });
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
  gl.texImage2D(gl.TEXTURE_2D, 0, isData ? gl.RGBA8 : gl.SRGB8_ALPHA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
  gl.generateMipmap(gl.TEXTURE_2D);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, nearest ? gl.NEAREST : gl.LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, wraps[wrapS]);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, wraps[wrapT]);
  const anisotropic = gl.getExtension("EXT_texture_filter_anisotropic");
  if (anisotropic) gl.texParameterf(gl.TEXTURE_2D, anisotropic.TEXTURE_MAX_ANISOTROPY_EXT, Math.min(MOST_ANISOTROPY, gl.getParameter(anisotropic.MAX_TEXTURE_MAX_ANISOTROPY_EXT)));
}

/**
 * Makes the texture of the light around a mesh, blurred from level to level.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {Pick<import("./mesh-environment.js").LightTables, "levels">} tables
 * @returns {WebGLTexture}
 */
export function aroundTexture(gl, { levels }) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  levels.forEach(({ width, height, texels }, level) => gl.texImage2D(gl.TEXTURE_2D, level, gl.RGBA16F, width, height, 0, gl.RGBA, gl.FLOAT, texels));
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAX_LEVEL, levels.length - 1);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.REPEAT);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
  return texture;
}

/** The tables of the light that was computed last: several canvases draw it. @type {{source: unknown, key: string, tables: import("./mesh-environment.js").LightTables} | null} */
let latest = null;

/**
 * @param {MeshPacket} mesh
 * @param {string} chosen the light that replaces the mesh's, as JSON
 * @param {() => import("./mesh-environment.js").Environment | null} environment
 * @param {import("./mesh-environment.js").Surroundings} surroundings
 */
export function tablesOf(mesh, chosen, environment, surroundings) {
  const source = mesh.environment ?? mesh.isStudio; // the studio's light is the same for all meshes
  const key = chosen + JSON.stringify(surroundings);
  if (latest?.source !== source || latest.key !== key) latest = { source, key, tables: lightTables(environment(), surroundings) };
  return latest.tables;
}
