/** Textures that a preview mesh's shadows are drawn into. */

/** @param {WebGL2RenderingContext} gl @param {number} unit @param {WebGLTexture | null} texture of two dimensions */
export function bindTexture(gl, unit, texture) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, texture);
}

/** Returns a texture of colours, which is bound to the active unit. @param {WebGL2RenderingContext} gl @param {number} width @param {number} height @param {number} format @param {number} [levels] */
export function colorTarget(gl, width, height, format, levels = 1) {
  const texture = stored(gl, width, height, format, levels, gl.LINEAR);
  if (levels > 1) gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  return texture;
}

/** Returns a texture of depths, which is bound to the active unit. @param {WebGL2RenderingContext} gl @param {number} width @param {number} height @param {number} format @param {boolean} [isCompared] whether shaders compare depths with it, and blend the results of four texels */
export function depthTarget(gl, width, height, format, isCompared = false) {
  const texture = stored(gl, width, height, format, 1, isCompared ? gl.LINEAR : gl.NEAREST);
  if (isCompared) gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
  return texture;
}

/** @param {WebGL2RenderingContext} gl @param {number} width @param {number} height @param {number} format @param {number} levels @param {number} filter */
function stored(gl, width, height, format, levels, filter) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, levels, format, width, height);
  for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, filter);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
  return texture;
}
