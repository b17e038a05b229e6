/** The maps of depth that a preview mesh's shadows are computed with: drawn once for a mesh, from directions of the light and from lamps. */

import { FLOOR_TEXELS } from "./mesh-floor-shader.js";
import { VERTEX } from "./mesh-shader.js";
import { albedoAxes, boxOf, extentOf, floorMap, lampTilesOf, matrixOf, placeOf, radiusOf, rowsTowards } from "./mesh-shadow-places.js";
import { ACROSS, ALBEDO_FRAGMENT, BASE_FRAGMENT, DEPTH_FRAGMENT, LAMP_DEPTH_FRAGMENT } from "./mesh-shadow-shader.js";
import { bindTexture, colorTarget, depthTarget } from "./mesh-targets.js";

/** @typedef {import("../news/mesh-packet.js").Lamp} Lamp */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */
/** @typedef {import("../news/mesh-packet.js").MeshPart} MeshPart */
/** @typedef {import("./mesh-shadow.js").Subject} Subject */

/** Side length of the directions' map and of the lamps' one in texels. */
const [MAP, LAMP_MAP] = [2048, 2048];
/** Height above the floor, in radii of the scene, up to which what lies on it is taken for a part of it: a base or a plate. */
export const BASE = 0.05;
/** Part of the light that passes through glass, besides what it refracts elsewhere. */
const CLEAR = 0.7;
/** Golden ratio: its multiples are even thresholds of opacity, so that light passes a surface in a share of the directions. */
const GOLDEN = 0.618034;

/** @param {MeshMaterial} material */
const opacityOf = ({ transmission }) => 1 - CLEAR * transmission;

export class ShadowMaps {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {(vertex: string, fragment: string) => import("./mesh-program.js").Linked | null} programOf
   */
  constructor(gl, programOf) {
    this.gl = gl;
    this.programOf = programOf;
    this.frame = gl.createFramebuffer();
    gl.activeTexture(gl.TEXTURE0 + 9);
    this.directions = depthTarget(gl, MAP, MAP, gl.DEPTH_COMPONENT16, true);
    /** Reads the depths of a map without comparing them. */
    this.uncompared = gl.createSampler();
    gl.samplerParameteri(this.uncompared, gl.TEXTURE_COMPARE_MODE, gl.NONE);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.samplerParameteri(this.uncompared, name, gl.NEAREST);
    /** @type {WebGLTexture | null} */
    this.lamps = null;
    /** Depth of the floor and what lies on it, from above. */
    this.base = depthTarget(gl, FLOOR_TEXELS, FLOOR_TEXELS, gl.DEPTH_COMPONENT24);
    /** Depth of the scene from below and from above, in two quarters. */
    this.sides = depthTarget(gl, FLOOR_TEXELS, FLOOR_TEXELS, gl.DEPTH_COMPONENT24);
    /** Albedo of the scene, likewise. */
    this.albedos = colorTarget(gl, FLOOR_TEXELS, FLOOR_TEXELS, gl.RGBA8, Math.log2(FLOOR_TEXELS) + 1);
    /** @type {Subject | null} */
    this.subject = null;
    /** To a direction, the three rows of its projection. @type {number[][]} */
    this.rows = [];
    /** Directions whose tiles are drawn. */
    this.drawn = 0;
    /** @type {{lamp: number, matrix: number[], texel: number}[]} */
    this.lampTiles = [];
    this.areLampsDrawn = false;
    /** Bounds of the parts that shine, relative to the mesh's middle. @type {Map<MeshPart, {low: number[], high: number[]}>} */
    this.shining = new Map();
  }

  /** Takes the parts of a mesh, and unless it has the shape of the last one, forgets what is drawn. @param {Subject} subject @param {import("./mesh-light-samples.js").LightSample[]} samples @param {boolean} isAlike */
  begin(subject, samples, isAlike) {
    const { mesh, lamps } = subject;
    this.subject = subject;
    this.shining = new Map(lamps.length ? mesh.parts.filter(({ material }) => Math.max(...(mesh.materials[material]?.emission ?? [])) > 0).map((part) => [part, boxOf(mesh, part)]) : []);
    if (isAlike) return;
    this.rows = samples.map(({ way }, i) => rowsTowards(way, i, radiusOf(mesh)));
    this.drawn = 0;
    this.lampTiles = lampTilesOf(mesh, lamps);
    this.areLampsDrawn = false;
  }

  /** Width of a texel of the directions' map, in the scene. */
  get texelSize() {
    return this.subject ? (2 * radiusOf(this.subject.mesh) * ACROSS) / MAP : 0;
  }

  /** Number of the lamps' tiles in a row, and the side length of one. */
  get lampGrid() {
    const across = Math.ceil(Math.sqrt(this.lampTiles.length));
    const side = Math.floor(LAMP_MAP / across);
    return { across, side, filled: (side * across) / LAMP_MAP };
  }

  /**
   * Begins to draw into a map.
   *
   * @param {WebGLTexture} texture
   * @param {number} side in texels
   * @param {boolean} isCleared
   * @param {string} [fragment] the shader
   */
  target(texture, side, isCleared, fragment = DEPTH_FRAGMENT) {
    const { gl } = this;
    const linked = this.programOf(VERTEX, fragment);
    if (!linked) return null;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, texture, 0);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.viewport(0, 0, side, side);
    if (isCleared) gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(linked.program);
    return linked;
  }

  /** Draws the albedo of the scene as it is seen from below and from above. */
  drawAlbedos() {
    const { gl, subject } = this;
    const linked = subject && this.target(this.sides, FLOOR_TEXELS, true, ALBEDO_FRAGMENT);
    if (!linked) return;
    const across = albedoAxes(subject).map((axis) => axis.map((value) => 2 * value));
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.albedos, 0);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.uniform1f(linked.at("threshold"), 0.5);
    const [{ above, height }, radius] = [floorMap(subject), radiusOf(subject.mesh)];
    gl.uniform3fv(linked.at("above"), above);
    for (const view of [0, 1]) {
      const away = above.map((value) => ((view ? -1 : 1) * value) / radius);
      gl.viewport((view * FLOOR_TEXELS) / 2, 0, FLOOR_TEXELS / 2, FLOOR_TEXELS / 2);
      gl.uniform1f(linked.at("top"), view || subject.isAlone ? -2 * radius : height + BASE * radius);
      this.drawSolids(linked, matrixOf([...across, away].flatMap((axis) => [...axis, 0])), opacityOf);
    }
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, null, 0);
    this.bind(9, this.albedos);
    gl.generateMipmap(gl.TEXTURE_2D);
  }

  /** Draws what lies on the floor, as it is seen from above. */
  drawBase() {
    const { gl, subject } = this;
    const linked = subject && this.target(this.base, FLOOR_TEXELS, true, BASE_FRAGMENT);
    if (!linked) return;
    const { above, height, floorX, floorY } = floorMap(subject);
    const thick = BASE * radiusOf(subject.mesh);
    gl.uniform1f(linked.at("threshold"), 0.5);
    gl.uniform3fv(linked.at("above"), above);
    gl.uniform1f(linked.at("top"), height + thick);
    // From the near plane at its top to the far one on the floor.
    const rows = [[...floorX.map((value) => 2 * value), 0], [...floorY.map((value) => 2 * value), 0], [...above.map((value) => (-2 * value) / thick), 1 + (2 * height) / thick]].flat();
    const toBase = matrixOf(rows);
    for (const axis of [0, 1, 2]) toBase[12 + axis] = rows[4 * axis + 3] ?? 0;
    this.drawSolids(linked, toBase, opacityOf);
  }

  /** Draws the depth of the scene as it is seen from further directions. @param {number} count */
  drawDirections(count) {
    const { gl } = this;
    const linked = this.target(this.directions, MAP, !this.drawn);
    if (!linked) return;
    const side = MAP / ACROSS;
    for (const end = Math.min(this.drawn + count, this.rows.length); this.drawn < end; this.drawn++) {
      gl.viewport(side * (this.drawn % ACROSS), side * Math.floor(this.drawn / ACROSS), side, side);
      gl.uniform1f(linked.at("threshold"), ((this.drawn + 0.5) * GOLDEN) % 1);
      this.drawSolids(linked, matrixOf(this.rows[this.drawn] ?? []), opacityOf);
    }
  }

  /** Draws what the lamps see, unless it is drawn. */
  drawLamps() {
    const { gl, subject } = this;
    if (this.areLampsDrawn || !subject) return;
    this.areLampsDrawn = true;
    if (!this.lamps) {
      gl.activeTexture(gl.TEXTURE0 + 9);
      this.lamps = depthTarget(gl, LAMP_MAP, LAMP_MAP, gl.DEPTH_COMPONENT24, true);
    }
    const linked = this.target(this.lamps, LAMP_MAP, true, LAMP_DEPTH_FRAGMENT);
    if (!linked) return;
    const { across, side } = this.lampGrid;
    this.lampTiles.forEach(({ lamp, matrix }, tile) => {
      const place = placeOf(subject.mesh, /** @type {Lamp} */ (subject.lamps[lamp]));
      gl.viewport(side * (tile % across), side * Math.floor(tile / across), side, side);
      this.drawSolids(linked, Float32Array.from(matrix), (material, part) => (place[3] && this.isAround(part, place) ? 0 : opacityOf(material)));
    });
  }

  /** Returns whether a part shines and surrounds a lamp: then the lamp stands for it. @param {MeshPart} part @param {number[]} place */
  isAround(part, place) {
    const box = this.shining.get(part);
    return box !== undefined && [0, 1, 2].every((axis) => (place[axis] ?? 0) >= (box.low[axis] ?? 0) && (place[axis] ?? 0) <= (box.high[axis] ?? 0));
  }

  /**
   * Draws the parts that hold light back.
   *
   * @param {import("./mesh-program.js").Linked} linked its program is in use
   * @param {Float32Array<ArrayBuffer>} toClip
   * @param {(material: MeshMaterial, part: MeshPart) => number} solid share of the light that a part holds back; 0: it is not drawn
   */
  drawSolids({ at }, toClip, solid) {
    const { gl, subject } = this;
    if (!subject) return;
    const { mesh, drawPart } = subject;
    gl.uniformMatrix4fv(at("toClip"), false, toClip);
    gl.uniform3fv(at("extent"), extentOf(mesh));
    gl.uniform1i(at("image"), 0);
    for (const part of mesh.parts) {
      const material = /** @type {MeshMaterial} */ (mesh.materials[part.material]);
      const share = solid(material, part);
      gl.uniform1f(at("solid"), share);
      if (share > 0) drawPart(part, material, at);
    }
  }

  /** Binds a map for shaders. @param {number} unit @param {WebGLTexture | null} texture */
  bind(unit, texture) {
    bindTexture(this.gl, unit, texture);
  }
}
