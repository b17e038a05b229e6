/** Reflections in the mirrors of a preview mesh: its other surfaces, drawn once from a point into the six sides of a cube, with their depths. */

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */

/** Side length in texels. */
export const SIDE = 128;
/** Bounds of the depths, in radii of the scene. */
export const [NEAR, FAR] = [0.01, 2.1];
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

/** Maximum number of mirrors with cubes of their own, and of triangles that are drawn for a side of all of these. */
const [MOST_OWN, MOST_TRIANGLES] = [4, 100_000];

/** Colours and depths of the surfaces around a point. @typedef {{color: WebGLTexture, depth: WebGLTexture}} Cube */

/** Returns whether a surface reflects or refracts the others. @param {MeshMaterial} material */
export const isMirror = ({ metallic, roughness, f0, transmission }) => transmission > 0 || (roughness < ROUGH && (metallic > 0.5 || Math.max(...f0) > REFLECTS));

/**
 * Assigns mirrors to cubes. The largest have cubes of their own, drawn from their middles, so that near surfaces are in their places and
 * these mirrors show each other; the others share one that is drawn from the middle of the scene.
 *
 * @template {{middle: Vec3, size: number}} Mirror
 * @param {Mirror[]} mirrors
 * @param {number} triangles of the mesh
 * @returns {{from: Vec3, of: Mirror[]}[]}
 */
export function viewpoints(mirrors, triangles) {
  const own = Math.min(MOST_OWN, Math.floor(MOST_TRIANGLES / triangles));
  const largestFirst = mirrors.toSorted((a, b) => b.size - a.size);
  const alone = mirrors.length === 1 ? 1 : mirrors.length <= own ? mirrors.length : Math.max(own - 1, 0);
  const found = largestFirst.slice(0, alone).map((each) => ({ from: each.middle, of: [each] }));
  if (alone < mirrors.length) found.push({ from: [0, 0, 0], of: largestFirst.slice(alone) });
  return found;
}

/**
 * Draws a cube.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {number} radius of the scene
 * @param {Vec3} from where it is seen from
 * @param {(toClip: Float32Array<ArrayBuffer>, isSeen: (part: {middle: Vec3, size: number}) => boolean) => void} draw draws a side
 * @returns {Cube} not bound to the active unit
 */
export function mirrorCube(gl, radius, from, draw) {
  const unit = gl.getParameter(gl.ACTIVE_TEXTURE);
  const depth = cubeTexture(gl, 1, gl.DEPTH_COMPONENT24, gl.NEAREST, gl.NEAREST);
  const color = cubeTexture(gl, Math.log2(SIDE) + 1, gl.RGBA8, gl.LINEAR_MIPMAP_LINEAR, gl.LINEAR);
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, null); // shaders must not read what they write
  const frame = gl.createFramebuffer();
  SIDES.forEach(([right, up, forward], side) => {
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    const face = gl.TEXTURE_CUBE_MAP_POSITIVE_X + side;
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, face, color, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, face, depth, 0);
    gl.viewport(0, 0, SIDE, SIDE);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    draw(projection(from, right, up, forward, NEAR * radius, FAR * radius), ({ middle, size }) => {
      const way = middle.map((value, i) => value - (from[i] ?? 0));
      return [right, up].every((axis) => [1, -1].every((sign) => way.reduce((sum, value, i) => sum + value * ((forward[i] ?? 0) + sign * (axis[i] ?? 0)), 0) > -Math.SQRT2 * size));
    });
  });
  gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  gl.deleteFramebuffer(frame);
  gl.activeTexture(unit);
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, color);
  gl.generateMipmap(gl.TEXTURE_CUBE_MAP);
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, null);
  return { color, depth };
}

/** Returns a texture that is bound to the active unit. @param {WebGL2RenderingContext} gl @param {number} levels @param {number} format @param {number} smaller filter @param {number} larger filter */
function cubeTexture(gl, levels, format, smaller, larger) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_CUBE_MAP, texture);
  gl.texStorage2D(gl.TEXTURE_CUBE_MAP, levels, format, SIDE, SIDE);
  gl.texParameteri(gl.TEXTURE_CUBE_MAP, gl.TEXTURE_MIN_FILTER, smaller);
  gl.texParameteri(gl.TEXTURE_CUBE_MAP, gl.TEXTURE_MAG_FILTER, larger);
  return texture;
}

/** Returns the matrix, column by column, of a view of 90 degrees. @param {Vec3} from @param {Vec3} right @param {Vec3} up @param {Vec3} forward @param {number} near @param {number} far */
function projection(from, right, up, forward, near, far) {
  const depth = (far + near) / (far - near);
  const along = (/** @type {Vec3} */ axis) => axis.reduce((sum, value, i) => sum - value * (from[i] ?? 0), 0); // that of the middle
  const rows = [[...right, along(right)], [...up, along(up)], [...forward.map((value) => depth * value), depth * along(forward) - (2 * far * near) / (far - near)], [...forward, along(forward)]];
  return Float32Array.from({ length: 16 }, (_, at) => rows[at % 4]?.[at >> 2] ?? 0);
}
