/**
 * Reflections in the mirrors of a preview mesh: its other surfaces, drawn once from a point into the six sides of a cube, with their depths. Balls have
 * a cube of their own: rays are intersected with them exactly, and they hide nothing of the rest.
 */

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */
/** @typedef {import("../news/mesh-packet.js").MeshPart} MeshPart */
/** @typedef {import("./mesh-parts.js").Place & {part: MeshPart, material: MeshMaterial, showsScene: boolean}} Surface */

/** Side length in texels. */
export const SIDE = 128;
/** Balls that rays are intersected with. */
export const MOST_BALLS = 8;
/** Bounds of the depths, in radii of the scene. */
export const [NEAR, FAR] = [0.01, 2.1];
/** How often balls are drawn into the cubes: with what is seen in mirrors that are seen in them, and once more with that. */
const SWEEPS = 2;
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

/** Texture units of the cubes: of their colours; and of their depths, and of balls, with a projected picture and without. */
export const MIRROR_UNITS = { color: 9, depth: { kept: 15, alone: 1 }, balls: { kept: 14, alone: 2 } };

/** Colours and depths of the surfaces around a point. @typedef {{color: WebGLTexture, depth: WebGLTexture}} Cube */
/** What some mirrors show. from: where it is drawn from. isFollowed: whether rays meet it elsewhere than at the bounds of the scene. balls: colours only; null: none is drawn. @typedef {Cube & {from: Vec3, of: Set<MeshPart>, isFollowed: boolean, balls: WebGLTexture | null}} Mirrored */
/** What is being drawn into a cube. isChosen: whether a surface is drawn, and isSeen: on this side. isReflecting: whether mirrors show their cubes. @typedef {{from: Vec3, isChosen: (surface: Surface) => boolean, isSeen: (surface: Surface) => boolean, isReflecting: boolean}} Drawing */

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

/** The scene as its mirrors see it. */
export class MeshMirrors {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    /** Format of the cubes' colours: half floats, which also hold the radiance of emissive surfaces, if the browser can draw them. */
    this.format = gl.getExtension("EXT_color_buffer_float") ? gl.RGBA16F : gl.SRGB8_ALPHA8;
    /** @type {Mirrored[]} */
    this.cubes = [];
    /** @type {Surface[]} */
    this.balls = [];
    /** @type {Drawing | null} */
    this.drawing = null;
    /** With what light and what exposure it is drawn. @type {unknown[] | null} */
    this.look = null;
  }

  forget() {
    for (const { color, depth, balls } of this.cubes) for (const each of [color, depth, balls]) this.gl.deleteTexture(each);
    this.cubes = [];
    this.look = null;
  }

  /**
   * Draws the scene for its mirrors, unless it is drawn in this light and with this exposure.
   *
   * @param {Surface[]} surfaces
   * @param {{radius: number, triangles: number, lamps: Set<MeshPart>, look: unknown[]}} scene lamps: what shines, and is not drawn
   * @param {(toClip: Float32Array<ArrayBuffer>) => void} draw draws the side of a cube, as `drawing` tells
   */
  draw(surfaces, { radius, triangles, lamps, look }, draw) {
    const { gl } = this;
    if (this.look?.every((value, i) => value === look[i])) return;
    this.forget();
    this.look = look;
    const mirrors = surfaces.filter(({ showsScene }) => showsScene);
    if (!mirrors.length) return;
    this.balls = surfaces.filter(({ radius: own, material }) => own > 0 && material.alpha_mode === "opaque").toSorted((a, b) => b.size - a.size).slice(0, MOST_BALLS);
    gl.enable(gl.DEPTH_TEST);
    this.bindCubes(null, null, null, false); // shaders must not read what they write
    const isBall = (/** @type {Surface} */ { part }) => this.balls.some((each) => each.part === part);
    /** @param {Vec3} from @param {(surface: Surface) => boolean} isChosen @param {boolean} isReflecting */
    const cubeOf = (from, isChosen, isReflecting) =>
      mirrorCube(gl, this.format, radius, from, (toClip, isSeen) => {
        this.drawing = { from, isReflecting, isChosen, isSeen };
        draw(toClip);
      });
    for (const { from, of } of viewpoints(mirrors, triangles)) {
      if (of.length === surfaces.length) continue; // nothing else is seen
      const showing = new Set(of.map(({ part }) => part));
      const rest = surfaces.filter((each) => !showing.has(each.part) && !isBall(each) && !lamps.has(each.part));
      const cube = cubeOf(from, ({ part }) => rest.some((each) => each.part === part), false);
      this.cubes.push({ ...cube, from, of: showing, isFollowed: rest.some(({ isOutside }) => !isOutside), balls: null });
    }
    for (let sweep = 0; this.balls.length && sweep < Math.min(SWEEPS, this.cubes.length); sweep++)
      for (const cube of this.cubes) {
        const { color, depth } = cubeOf(cube.from, (each) => isBall(each) && !cube.of.has(each.part), true);
        for (const each of [depth, cube.balls]) gl.deleteTexture(each);
        cube.balls = color;
      }
    this.drawing = null;
  }

  /** @param {WebGLTexture | null} color @param {WebGLTexture | null} depth @param {WebGLTexture | null} balls @param {boolean} isKept */
  bindCubes(color, depth, balls, isKept) {
    const { gl } = this;
    const of = isKept ? "kept" : "alone";
    for (const [unit, texture] of /** @type {const} */ ([
      [MIRROR_UNITS.color, color],
      [MIRROR_UNITS.depth[of], depth],
      [MIRROR_UNITS.balls[of], balls],
    ])) {
      gl.activeTexture(gl.TEXTURE0 + unit);
      gl.bindTexture(gl.TEXTURE_CUBE_MAP, texture);
    }
  }

  /** What programs of mirrors must do. @returns {import("./mesh-program.js").Feature[]} */
  get features() {
    if (!this.isReflecting) return [];
    return ["MIRRORS", ...(this.balls.length ? /** @type {const} */ (["BALLS"]) : []), ...(this.cubes.some(({ isFollowed }) => isFollowed) ? /** @type {const} */ (["FOLLOWED"]) : [])];
  }

  /** Whether surfaces show cubes in what is drawn now. */
  get isReflecting() {
    return this.cubes.length > 0 && (this.drawing?.isReflecting ?? true);
  }

  /**
   * Binds the cube of a mirror. Returns false if it has none.
   *
   * @param {MeshPart} part
   * @param {(name: string) => WebGLUniformLocation | null} at finds the program's uniforms
   * @param {boolean} isKept whether there is a projected picture
   */
  bind(part, at, isKept) {
    const { gl, balls } = this;
    const cube = this.isReflecting && this.cubes.find(({ of }) => of.has(part));
    if (!cube) return false;
    const drawn = cube.balls ? balls.filter((each) => !cube.of.has(each.part)) : [];
    gl.uniform3fv(at("mirroredFrom"), cube.from);
    gl.uniform1i(at("ballCount"), drawn.length);
    if (drawn.length) gl.uniform4fv(at("balls"), drawn.flatMap(({ middle, radius, showsScene }) => [...middle, showsScene ? -radius : radius]));
    this.bindCubes(cube.color, cube.depth, cube.balls, isKept);
    return true;
  }
}

/**
 * Draws a cube.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {number} format of the colours
 * @param {number} radius of the scene
 * @param {Vec3} from where it is seen from
 * @param {(toClip: Float32Array<ArrayBuffer>, isSeen: (surface: {middle: Vec3, size: number}) => boolean) => void} draw draws a side
 * @returns {Cube} bound to no unit
 */
function mirrorCube(gl, format, radius, from, draw) {
  const unit = gl.getParameter(gl.ACTIVE_TEXTURE);
  const depth = cubeTexture(gl, 1, gl.DEPTH_COMPONENT24, gl.NEAREST, gl.NEAREST);
  const color = cubeTexture(gl, Math.log2(SIDE) + 1, format, gl.LINEAR_MIPMAP_LINEAR, gl.LINEAR);
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
