/** Reflections in the mirrors of a preview mesh: its other surfaces, drawn once from a point into the six sides of a cube. */

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */

/** Side length in texels. */
const SIDE = 128;
/** Bounds of the depths, in radii of the scene. */
const [NEAR, FAR] = [0.01, 2.1];
/** Least reflectance, and greatest roughness, of a surface that shows other surfaces. */
const [REFLECTS, ROUGH] = [0.15, 0.6];
/** The directions to the right, up and forward of each side, as OpenGL defines them. */
const SIDES = /** @type {[Vec3, Vec3, Vec3][]} */ ([
  [[0, 0, -1], [0, -1, 0], [1, 0, 0]],
  [[0, 0, 1], [0, -1, 0], [-1, 0, 0]],
  [[1, 0, 0], [0, 0, 1], [0, 1, 0]],
  [[1, 0, 0], [0, 0, -1], [0, -1, 0]],
  [[1, 0, 0], [0, -1, 0], [0, 0, 1]],
  [[-1, 0, 0], [0, -1, 0], [0, 0, -1]],
]);

/** Returns whether a surface reflects or refracts the others. Such surfaces are not drawn into the cube. @param {MeshMaterial} material */
export const isMirror = ({ metallic, roughness, f0, transmission }) => transmission > 0 || (roughness < ROUGH && (metallic > 0.5 || Math.max(...f0) > REFLECTS));

/**
 * Draws the cube.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {number} radius of the scene
 * @param {Vec3} from where it is seen from
 * @param {(toClip: Float32Array<ArrayBuffer>) => void} draw
 * @returns {WebGLTexture} bound to the active unit
 */
export function mirrorTexture(gl, radius, from, draw) {
  const unit = gl.getParameter(gl.ACTIVE_TEXTURE);
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, texture);
  gl.texStorage2D(gl.TEXTURE_CUBE_MAP, Math.log2(SIDE) + 1, gl.RGBA8, SIDE, SIDE);
  gl.texParameteri(gl.TEXTURE_CUBE_MAP, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  const frame = gl.createFramebuffer();
  const depth = gl.createRenderbuffer();
  gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
  gl.bindRenderbuffer(gl.RENDERBUFFER, depth);
  gl.renderbufferStorage(gl.RENDERBUFFER, gl.DEPTH_COMPONENT24, SIDE, SIDE);
  gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.RENDERBUFFER, depth);
  gl.clearColor(0, 0, 0, 0);
  SIDES.forEach(([right, up, forward], side) => {
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_CUBE_MAP_POSITIVE_X + side, texture, 0);
    gl.viewport(0, 0, SIDE, SIDE);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    draw(projection(from, right, up, forward, NEAR * radius, FAR * radius));
  });
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.deleteFramebuffer(frame);
  gl.deleteRenderbuffer(depth);
  gl.activeTexture(unit);
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, texture);
  gl.generateMipmap(gl.TEXTURE_CUBE_MAP);
  return texture;
}

/** Returns the matrix, column by column, of a view of 90 degrees. @param {Vec3} from @param {Vec3} right @param {Vec3} up @param {Vec3} forward @param {number} near @param {number} far */
function projection(from, right, up, forward, near, far) {
  const depth = (far + near) / (far - near);
  const along = (/** @type {Vec3} */ axis) => axis.reduce((sum, value, i) => sum - value * (from[i] ?? 0), 0); // that of the middle
  const rows = [[...right, along(right)], [...up, along(up)], [...forward.map((value) => depth * value), depth * along(forward) - (2 * far * near) / (far - near)], [...forward, along(forward)]];
  return Float32Array.from({ length: 16 }, (_, at) => rows[at % 4]?.[at >> 2] ?? 0);
}
