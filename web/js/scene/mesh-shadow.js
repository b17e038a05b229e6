/**
 * The shadows of a preview mesh: how much of the light from around each point misses, since something else is seen in its direction, and
 * which part of each lamp's light reaches it. The light from around is sampled by directions, of each of which a map of depth is drawn once
 * for a mesh; they are few at first and more from frame to frame. For each camera the maps are compared with what it sees; for the floor
 * below the scene, once. Source: the accumulation of shadow maps of many light samples, Brotman and Badler 1984; Haeberli and Akeley 1990.
 */

import { irradianceAt } from "./mesh-environment.js";
import { FLOOR_TEXELS } from "./mesh-floor-shader.js";
import { lightSamples } from "./mesh-light-samples.js";
import { VERTEX } from "./mesh-shader.js";
import { ACROSS, DEPTH_FRAGMENT, GATHER_FRAGMENT, GATHER_VERTEX, LAMPS_FRAGMENT, MOST_LAMP_TILES, NORMAL_FRAGMENT, TILES } from "./mesh-shadow-shader.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").Lamp} Lamp */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/** @typedef {import("../news/mesh-packet.js").MeshPart} MeshPart */
/** @typedef {import("./mesh-environment.js").LightTables} LightTables */

/** Batches of TILES directions. */
const BATCHES = 4;
/** Side length of a batch's map and of the lamps' one in texels. */
const [MAP, LAMP_MAP] = [2048, 2048];
/** Half the side length of the floor's map, in radii of the scene. */
const REACH = 3.5;
/** How far from the middle of the scene the map's corners are, in radii. */
export const FLOOR_REACH = 1 + REACH * Math.SQRT2;
/** Height above the floor, in radii of the scene, up to which what lies on it is taken for a part of it: a base or a plate. */
const BASE = 0.05;
/** Part of the light that other surfaces of the scene receive, which are seen in place of the light. */
const OPEN = 0.7;
/** Part of the light around that stays where surfaces are seen in its place, if it is but an estimate of what surfaces reflect. */
const REFLECTED = 0.6;
/** Part of the light that passes through glass, besides what it refracts elsewhere. */
const CLEAR = 0.7;
/** Texture units; those of the mesh are below. */
export const UNITS = { maps: 9, seenDepth: 10, seenNormal: 11, missed: 12, open: 13, floorMissed: 14, floorOpen: 15 };
/** Pixels of the view above which shadows are computed for every other one along a side. */
const MANY_PIXELS = 500_000;
/** Time, in milliseconds, that the shadows may take of a frame; and number of tiles that are drawn in a frame, at first and at least. */
const [BUDGET_MS, FIRST_TILES] = [25, 4];
/** Triangles above which the first frame has the shadows of FIRST_TILES directions, and else those of a batch. */
const MANY_TRIANGLES = 200_000;
/** Difference of two scenes' extents, of their size, up to which they have the same shape. */
const SLACK = 1e-4;

/** What a frame of shadows is drawn for. @typedef {{mesh: MeshPacket, tables: LightTables, lamps: Lamp[], above: Vec3 | null, isAlone: boolean, drawPart: (part: MeshPart, material: MeshMaterial, at: (name: string) => WebGLUniformLocation | null) => void}} Subject isAlone: whether only lamps light it. above: up in the scene, if it stands on a floor */

export class MeshShadows {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {import("./mesh-program.js").Programs} programs
   */
  constructor(gl, programs) {
    this.gl = gl;
    this.programs = programs;
    /** Whether the browser can add up light in a texture. */
    this.isPossible = gl.getExtension("EXT_color_buffer_float") !== null;
    /** @type {Subject | null} */
    this.subject = null;
    /** @type {import("./mesh-light-samples.js").LightSample[]} */
    this.samples = [];
    /** @type {number[][]} to a tile, three rows of each sample */
    this.rows = [];
    /** @type {number[]} */
    this.instead = [];
    /** Tiles of the samples that are drawn, batches that are gathered for the floor, and for the camera. */
    this.drawn = this.onFloor = this.gathered = 0;
    /** Whether the lamps' tiles are drawn, and gathered for the floor and the camera. */
    this.lampsDrawn = this.lampsGathered = false;
    this.tilesAtOnce = FIRST_TILES;
    /** @type {Float32Array<ArrayBuffer> | null} */
    this.toClip = null;
    /** @type {{maps: WebGLTexture, lampMaps: WebGLTexture | null, frame: WebGLFramebuffer, floorMissed: WebGLTexture, floorOpen: WebGLTexture, base: WebGLTexture} | null} base: depth of the floor and what lies on it, from above */
    this.kept = null;
    /** What the camera sees. @type {{width: number, height: number, depth: WebGLTexture, normal: WebGLTexture, missed: WebGLTexture, open: WebGLTexture} | null} */
    this.seen = null;
    /** Set once the work of the last frame is done, and when it began. @type {WebGLSync | null} */
    this.fence = null;
    this.begun = 0;
    /** Bounds of the parts that shine, relative to the mesh's middle. @type {Map<MeshPart, {low: number[], high: number[]}>} */
    this.shining = new Map();
    /** Tiles of the lamps. @type {{lamp: number, matrix: number[], texel: number}[]} */
    this.lampTiles = [];
  }

  /** Whether nothing is left to do. */
  get isDone() {
    return !this.isPossible || !this.subject || (this.gathered === this.batches && this.lampsGathered);
  }

  /** Whether a whole batch is drawn between two frames: then the picture can be drawn in each. */
  get isFast() {
    return this.tilesAtOnce >= TILES;
  }

  /** Number of batches in all. */
  get batches() {
    return this.samples.length / TILES;
  }

  /** Begins the shadows of another mesh, or of another light; those of the same shape, which the service has read too, stay. @param {Subject} subject */
  begin(subject) {
    const { gl } = this;
    const isAlike = this.subject !== null && isSameShape(this.subject, subject);
    this.subject = subject;
    this.toClip = null;
    const { mesh, tables, lamps } = subject;
    this.shining = new Map(lamps.length ? mesh.parts.filter(({ material }) => Math.max(...(mesh.materials[material]?.emission ?? [])) > 0).map((part) => [part, boxOf(mesh, part)]) : []);
    if (isAlike) return;
    const table = /** @type {LightTables["levels"][number]} */ (tables.levels[0]);
    this.samples = lightSamples(table, BATCHES * TILES);
    const radius = radiusOf(mesh);
    this.rows = this.samples.map(({ way }, i) => rowsTowards(way, i, radius));
    const albedo = albedoOf(mesh);
    this.instead = this.samples.flatMap(({ way, weight, color }) => subject.isAlone ? color.map((value) => REFLECTED * value) : irradianceAt(tables.irradiance, /** @type {Vec3} */ (way.map((value) => -value))).map((value, k) => OPEN * weight * value * (albedo[k] ?? 0)));
    this.drawn = this.onFloor = this.gathered = 0;
    this.lampTiles = lampTilesOf(mesh, lamps);
    this.lampsDrawn = this.lampsGathered = !this.lampTiles.length;
    this.kept ??= {
      ...{ maps: this.depthArray(MAP, BATCHES, gl.DEPTH_COMPONENT16), lampMaps: null, frame: gl.createFramebuffer() },
      ...{ floorMissed: this.target(FLOOR_TEXELS, FLOOR_TEXELS, gl.RGBA16F), floorOpen: this.target(FLOOR_TEXELS, FLOOR_TEXELS, gl.RGBA8) },
      base: this.depthTexture(FLOOR_TEXELS, FLOOR_TEXELS),
    };
    if (this.lampTiles.length) this.kept.lampMaps ??= this.depthArray(LAMP_MAP, 1, gl.DEPTH_COMPONENT24);
    this.clear(this.kept.floorMissed, 0);
    this.clear(this.kept.floorOpen, 1);
    this.mipmap();
  }

  /** Draws what the first frame is shown with, few directions where there are many triangles, and gathers it for the floor. */
  drawFirst() {
    const { gl, subject, samples } = this;
    if (this.drawn || !samples.length || !subject) return;
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    if (subject.above) this.drawBase();
    this.drawTiles(subject.mesh.triangles > MANY_TRIANGLES ? FIRST_TILES : TILES);
    if (subject.above) this.gather(0, true);
    if (this.drawn === TILES) this.onFloor = 1;
  }

  /** Begins anew: the texture of a surface that is partly transparent has arrived. */
  renew() {
    const { subject } = this;
    this.subject = null;
    if (subject) this.begin(subject);
  }

  /**
   * Takes what another camera sees.
   *
   * @param {Float32Array<ArrayBuffer>} toClip
   * @param {number[]} eye as the mesh's shaders have it
   * @param {{width: number, height: number}} size of the canvas
   */
  follow(toClip, eye, size) {
    const { gl, subject } = this;
    if (!subject) return;
    const share = size.width * size.height > MANY_PIXELS ? 2 : 1;
    const [width, height] = [Math.ceil(size.width / share), Math.ceil(size.height / share)];
    const isSame = this.seen?.width === width && this.seen.height === height && this.toClip?.every((value, i) => value === toClip[i]);
    if (isSame) return;
    if (this.seen?.width !== width || this.seen.height !== height) {
      this.forget();
      this.seen = { width, height, depth: this.depthTexture(width, height), normal: this.target(width, height, gl.RGBA8), missed: this.target(width, height, gl.RGBA16F), open: this.target(width, height, gl.RGBA8) };
    }
    this.toClip = Float32Array.from(toClip);
    this.gathered = 0;
    this.lampsGathered = !this.lampTiles.length;
    const { seen } = this;
    const linked = this.program(VERTEX, NORMAL_FRAGMENT);
    if (!seen || !linked || !this.kept) return;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.kept.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, seen.normal, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, seen.depth, 0);
    gl.viewport(0, 0, width, height);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(linked.program);
    gl.uniform1i(linked.at("isHalved"), 0);
    gl.uniform4fv(linked.at("eye"), eye);
    this.drawSolids(linked, toClip, ({ transmission, alpha_mode: mode }) => (transmission > 0 || mode === "blend" ? 0 : 1));
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, null, 0);
    this.clear(seen.missed, 0);
    this.clear(seen.open, 1);
    this.drawFirst();
    // Shadows that are known stay while the camera turns; those of few directions, where all take long.
    if (!this.lampsGathered) this.gatherLamps();
    const known = Math.floor(this.drawn / TILES);
    if (!known && this.drawn) this.gather(0, false);
    while (this.gathered < (this.isFast ? known : Math.min(known, 1))) this.gather(this.gathered++, false);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /**
   * Returns a program; notes if the driver refuses it: then there are no shadows.
   *
   * @param {string} vertex
   * @param {string} fragment
   * @param {import("./mesh-program.js").Feature[]} [features]
   */
  program(vertex, fragment, features = []) {
    const linked = this.programs.with(vertex, fragment, features);
    if (!linked) this.isPossible = false;
    return linked;
  }

  /** Draws and gathers what a frame has time for. @returns {boolean} whether what is shown has changed */
  work() {
    const { gl, subject } = this;
    if (this.isDone || !subject || !this.toClip) return false;
    if (this.fence) {
      const isOver = gl.clientWaitSync(this.fence, 0, 0) !== gl.TIMEOUT_EXPIRED;
      if (!isOver) return false;
      gl.deleteSync(this.fence);
      this.fence = null;
      const took = performance.now() - this.begun;
      if (took > 2 * BUDGET_MS) this.tilesAtOnce = Math.max(FIRST_TILES, this.tilesAtOnce / 2);
      else if (took < BUDGET_MS) this.tilesAtOnce = Math.min(2 * TILES, this.tilesAtOnce * 2);
    }
    this.begun = performance.now();
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    let hasChanged = false;
    const available = () => Math.floor(this.drawn / TILES);
    if (this.drawn < this.samples.length) {
      this.drawTiles(Math.min(this.tilesAtOnce, this.samples.length - this.drawn));
      if (subject.above)
        for (; this.onFloor < available(); this.onFloor++) {
          this.gather(this.onFloor, true);
          hasChanged = true;
        }
      // The first batches of what the camera sees had a floor of few directions.
      if (this.drawn === this.samples.length && subject.above) this.gathered = 0;
    }
    for (let i = 0; i < Math.max(1, this.tilesAtOnce / 8) && this.gathered < available(); i++) {
      this.gather(this.gathered++, false);
      hasChanged = true;
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    return hasChanged;
  }

  /** Draws what lies on the floor, as it is seen from above. */
  drawBase() {
    const { gl, kept, subject } = this;
    const linked = this.program(VERTEX, DEPTH_FRAGMENT);
    if (!kept || !subject || !linked) return;
    const { above, height, floorX, floorY } = floorMap(subject);
    const thick = BASE * radiusOf(subject.mesh);
    gl.bindFramebuffer(gl.FRAMEBUFFER, kept.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, null, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, kept.base, 0);
    gl.viewport(0, 0, FLOOR_TEXELS, FLOOR_TEXELS);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(linked.program);
    gl.uniform1i(linked.at("isHalved"), 1);
    // From the near plane at its top to the far one on the floor.
    const rows = [[...floorX.map((value) => 2 * value), 0], [...floorY.map((value) => 2 * value), 0], [...above.map((value) => (-2 * value) / thick), 1 + (2 * height) / thick]].flat();
    const toBase = matrixOf(rows);
    for (const axis of [0, 1, 2]) toBase[12 + axis] = rows[4 * axis + 3] ?? 0;
    this.drawSolids(linked, toBase, ({ transmission }) => 1 - CLEAR * transmission);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, null, 0);
  }

  /** Draws the depth of the scene as it is seen from further directions. @param {number} count */
  drawTiles(count) {
    const { gl, kept } = this;
    const linked = this.program(VERTEX, DEPTH_FRAGMENT);
    if (!kept || !linked) return;
    gl.bindFramebuffer(gl.FRAMEBUFFER, kept.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, null, 0);
    gl.useProgram(linked.program);
    gl.uniform1i(linked.at("isHalved"), 0);
    const side = MAP / ACROSS;
    for (const end = this.drawn + count; this.drawn < end; this.drawn++) {
      const tile = this.drawn % TILES;
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, kept.maps, 0, Math.floor(this.drawn / TILES));
      if (!tile) {
        gl.viewport(0, 0, MAP, MAP);
        gl.clear(gl.DEPTH_BUFFER_BIT);
      }
      gl.viewport(side * (tile % ACROSS), side * Math.floor(tile / ACROSS), side, side);
      this.drawSolids(linked, matrixOf(this.rows[this.drawn] ?? []), ({ transmission }) => 1 - CLEAR * transmission);
    }
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, null, 0);
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

  /** Adds up what a batch's light misses, or those directions of the first one that are drawn. @param {number} batch @param {boolean} isFloor whether on the floor, or else where the camera sees something */
  gather(batch, isFloor) {
    const { gl, kept, seen, subject, samples } = this;
    const linked = this.program(GATHER_VERTEX, GATHER_FRAGMENT, isFloor ? ["FLOOR"] : []);
    if (!kept || !seen || !subject || !linked) return;
    const { at } = linked;
    this.beginGathering(linked, isFloor ? kept.floorMissed : seen.missed, isFloor, batch);
    const first = batch * TILES;
    const count = Math.min(TILES, this.drawn - first);
    const scale = samples.length / count;
    bindTo(gl, UNITS.maps, gl.TEXTURE_2D_ARRAY, kept.maps);
    gl.uniform1f(at("layer"), batch);
    gl.uniform1i(at("count"), count);
    gl.uniform1f(at("texelSize"), (2 * radiusOf(subject.mesh) * ACROSS) / MAP);
    gl.uniform4fv(at("rows"), this.rows.slice(first, first + TILES).flat());
    gl.uniform3fv(at("ways"), samples.slice(first, first + TILES).flatMap(({ way }) => way));
    gl.uniform3fv(at("colors"), samples.slice(first, first + TILES).flatMap(({ color }) => color.map((value) => scale * value)));
    gl.uniform3fv(at("instead"), this.instead.slice(3 * first, 3 * (first + TILES)).map((value) => scale * value));
    if (!isFloor) this.setFloor(at);
    this.endGathering();
    if (isFloor) this.mipmap();
  }

  /** Draws the lamps' tiles unless they are drawn, and finds out where the lamps are seen. */
  gatherLamps() {
    const { gl, kept, seen, subject, lampTiles } = this;
    if (!kept || !seen || !subject) return;
    const across = Math.ceil(Math.sqrt(lampTiles.length));
    const side = Math.floor(LAMP_MAP / across);
    if (!this.lampsDrawn) {
      const linked = this.program(VERTEX, DEPTH_FRAGMENT);
      if (!linked) return;
      gl.bindFramebuffer(gl.FRAMEBUFFER, kept.frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, null, 0);
      gl.framebufferTextureLayer(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, kept.lampMaps, 0, 0);
      gl.viewport(0, 0, LAMP_MAP, LAMP_MAP);
      gl.clear(gl.DEPTH_BUFFER_BIT);
      gl.useProgram(linked.program);
      gl.uniform1i(linked.at("isHalved"), 1);
      lampTiles.forEach(({ lamp, matrix }, tile) => {
        const place = placeOf(subject.mesh, /** @type {Lamp} */ (subject.lamps[lamp]));
        gl.viewport(side * (tile % across), side * Math.floor(tile / across), side, side);
        this.drawSolids(linked, Float32Array.from(matrix), ({ transmission }, part) => (place[3] && this.isAround(part, place) ? 0 : 1 - CLEAR * transmission));
      });
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, null, 0);
    }
    for (const isFloor of [true, false]) {
      if (isFloor && (this.lampsDrawn || !subject.above)) continue;
      const linked = this.program(GATHER_VERTEX, LAMPS_FRAGMENT, isFloor ? ["FLOOR"] : []);
      if (!linked) return;
      const { at } = linked;
      this.beginGathering(linked, isFloor ? kept.floorOpen : seen.open, isFloor, 0);
      bindTo(gl, UNITS.maps, gl.TEXTURE_2D_ARRAY, kept.lampMaps);
      gl.uniform1f(at("layer"), 0);
      gl.uniform1i(at("count"), lampTiles.length);
      gl.uniform1i(at("across"), across);
      // The tiles fill the map but for a remainder of texels.
      gl.uniform1f(at("texelWidth"), 1 / side);
      gl.uniform1f(at("filled"), (side * across) / LAMP_MAP);
      gl.uniformMatrix4fv(at("toTile"), false, lampTiles.flatMap(({ matrix }) => matrix));
      gl.uniform2fv(at("lampOf"), lampTiles.flatMap(({ lamp, texel }) => [lamp, texel / side]));
      gl.uniform4fv(at("places"), subject.lamps.flatMap((lamp) => placeOf(subject.mesh, lamp)));
      this.endGathering();
    }
    this.lampsDrawn = this.lampsGathered = true;
  }

  /** Returns whether a part shines and surrounds a lamp: then the lamp stands for it. @param {MeshPart} part @param {number[]} place */
  isAround(part, place) {
    const box = this.shining.get(part);
    return box !== undefined && [0, 1, 2].every((axis) => (place[axis] ?? 0) >= (box.low[axis] ?? 0) && (place[axis] ?? 0) <= (box.high[axis] ?? 0));
  }

  /** @param {import("./mesh-program.js").Linked} linked @param {WebGLTexture} target @param {boolean} isFloor @param {number} before number of batches that are in the target */
  beginGathering({ program, at }, target, isFloor, before) {
    const { gl, kept, seen, subject } = this;
    if (!kept || !seen || !subject) return;
    gl.bindFramebuffer(gl.FRAMEBUFFER, kept.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.viewport(0, 0, isFloor ? FLOOR_TEXELS : seen.width, isFloor ? FLOOR_TEXELS : seen.height);
    gl.useProgram(program);
    gl.uniform1i(at("maps"), UNITS.maps);
    if (isFloor) {
      const { corner, alongX, alongY, above } = floorMap(subject);
      gl.uniform3fv(at("corner"), corner);
      gl.uniform3fv(at("alongX"), alongX);
      gl.uniform3fv(at("alongY"), alongY);
      gl.uniform3fv(at("above"), above);
      gl.uniform1f(at("thick"), BASE * radiusOf(subject.mesh));
      gl.uniform1i(at("base"), UNITS.seenDepth);
      bindTo(gl, UNITS.seenDepth, gl.TEXTURE_2D, kept.base);
    } else {
      gl.uniformMatrix4fv(at("toClip"), false, /** @type {Float32Array<ArrayBuffer>} */ (this.toClip));
      gl.uniform1i(at("seenDepth"), UNITS.seenDepth);
      gl.uniform1i(at("seenNormal"), UNITS.seenNormal);
      bindTo(gl, UNITS.seenDepth, gl.TEXTURE_2D, seen.depth);
      bindTo(gl, UNITS.seenNormal, gl.TEXTURE_2D, seen.normal);
    }
    gl.disable(gl.DEPTH_TEST);
    gl.enable(gl.BLEND);
    gl.blendColor(0, 0, 0, 1 / (before + 1));
    gl.blendFunc(gl.CONSTANT_ALPHA, gl.ONE_MINUS_CONSTANT_ALPHA);
  }

  endGathering() {
    const { gl } = this;
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
  }

  /** Sets what FLOOR_MAP_GLSL reads. @param {(name: string) => WebGLUniformLocation | null} at */
  setFloor(at) {
    const { gl, kept, subject } = this;
    if (!kept || !subject) return;
    const { above, height, floorX, floorY } = floorMap(subject);
    const floor = subject.tables.floor;
    gl.uniform4fv(at("floorPlane"), subject.above ? [...above, height] : [0, 0, 0, 0]);
    gl.uniform3fv(at("floorBounds"), extentOf(subject.mesh).map((value) => value / 2));
    gl.uniform3fv(at("floorX"), floorX);
    gl.uniform3fv(at("floorY"), floorY);
    gl.uniform1f(at("floorAlbedo"), floor?.albedo ?? 0);
    gl.uniform1f(at("floorSpread"), Math.sqrt(Math.max(1, this.samples.length / (this.onFloor * TILES || this.drawn || 1))));
    gl.uniform3fv(at("floorRadiance"), floor?.radiance ?? [1, 1, 1]);
    gl.uniform1i(at("floorMissed"), UNITS.floorMissed);
    gl.uniform1i(at("floorOpen"), UNITS.floorOpen);
    bindTo(gl, UNITS.floorMissed, gl.TEXTURE_2D, kept.floorMissed);
    bindTo(gl, UNITS.floorOpen, gl.TEXTURE_2D, kept.floorOpen);
  }

  /** Sets what the floor's shaders read. @param {(name: string) => WebGLUniformLocation | null} at */
  bindFloor(at) {
    const { gl, subject } = this;
    if (!subject) return;
    const { corner, alongX, alongY } = floorMap(subject);
    gl.uniform3fv(at("corner"), corner);
    gl.uniform3fv(at("alongX"), alongX);
    gl.uniform3fv(at("alongY"), alongY);
    this.setFloor(at);
  }

  /** Sets what the mesh's shaders read. @param {(name: string) => WebGLUniformLocation | null} at @param {{width: number, height: number}} size of the canvas */
  bind(at, { width, height }) {
    const { gl, seen } = this;
    if (!seen) return;
    this.setFloor(at);
    gl.uniform2f(at("perPixel"), 1 / width, 1 / height);
    gl.uniform1i(at("missedLight"), UNITS.missed);
    gl.uniform1i(at("openLamps"), UNITS.open);
    gl.uniform1i(at("seenDepth"), UNITS.seenDepth);
    bindTo(gl, UNITS.missed, gl.TEXTURE_2D, seen.missed);
    bindTo(gl, UNITS.open, gl.TEXTURE_2D, seen.open);
    bindTo(gl, UNITS.seenDepth, gl.TEXTURE_2D, seen.depth);
  }

  /** @param {WebGLTexture} target @param {number} value */
  clear(target, value) {
    const { gl, kept } = this;
    if (!kept) return;
    gl.bindFramebuffer(gl.FRAMEBUFFER, kept.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.clearColor(value, value, value, value);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  mipmap() {
    const { gl, kept } = this;
    bindTo(gl, UNITS.floorMissed, gl.TEXTURE_2D, kept?.floorMissed ?? null);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  }

  /** @param {number} width @param {number} height @param {number} format */
  target(width, height, format) {
    const { gl } = this;
    const texture = gl.createTexture();
    bindTo(gl, UNITS.missed, gl.TEXTURE_2D, texture);
    const levels = format === gl.RGBA16F && width === FLOOR_TEXELS && height === FLOOR_TEXELS ? Math.floor(Math.log2(FLOOR_TEXELS)) + 1 : 1;
    gl.texStorage2D(gl.TEXTURE_2D, levels, format, width, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    return texture;
  }

  /** @param {number} width @param {number} height */
  depthTexture(width, height) {
    const { gl } = this;
    const texture = gl.createTexture();
    bindTo(gl, UNITS.seenDepth, gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, width, height);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    return texture;
  }

  /** @param {number} side @param {number} layers @param {number} format */
  depthArray(side, layers, format) {
    const { gl } = this;
    const texture = gl.createTexture();
    bindTo(gl, UNITS.maps, gl.TEXTURE_2D_ARRAY, texture);
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, format, side, side, layers);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, name, gl.LINEAR);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D_ARRAY, name, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE);
    return texture;
  }

  forget() {
    for (const texture of this.seen ? [this.seen.depth, this.seen.normal, this.seen.missed, this.seen.open] : []) this.gl.deleteTexture(texture);
    this.seen = null;
  }
}

/** @param {WebGL2RenderingContext} gl @param {number} unit @param {number} target @param {WebGLTexture | null} texture */
function bindTo(gl, unit, target, texture) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(target, texture);
}

/** @param {MeshPacket} mesh @returns {Vec3} */
const extentOf = ({ low, high }) => /** @type {Vec3} */ (high.map((value, i) => value - (low[i] ?? 0)));

/** Returns the radius of the sphere around the scene's bounds. @param {MeshPacket} mesh */
const radiusOf = (mesh) => (Math.hypot(...extentOf(mesh)) / 2 || 1) * 1.001;

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {number[]} a @param {number[]} b */
const dot = (a, b) => a.reduce((sum, value, i) => sum + value * (b[i] ?? 0), 0);
/** @param {number[]} vector @returns {Vec3} */
const unit = (vector) => /** @type {Vec3} */ (vector.map((value) => value / (Math.hypot(...vector) || 1)));

/** Returns two unit vectors across a direction. @param {Vec3} way @param {number} turn in radians @returns {[Vec3, Vec3]} */
function acrossOf(way, turn) {
  const a = unit(cross(Math.abs(way[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0], way));
  const b = cross(way, a);
  const [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
  return [/** @type {Vec3} */ (a.map((value, i) => cosine * value + sine * (b[i] ?? 0))), /** @type {Vec3} */ (b.map((value, i) => cosine * value - sine * (a[i] ?? 0)))];
}

/** Returns whether two scenes cast the same shadows, but for textures. @param {Subject} a @param {Subject} b */
function isSameShape(a, b) {
  if (a.tables !== b.tables || a.mesh.triangles !== b.mesh.triangles || String(a.above) !== String(b.above) || JSON.stringify(a.lamps) !== JSON.stringify(b.lamps)) return false;
  const [extent, other] = [extentOf(a.mesh), extentOf(b.mesh)];
  return extent.every((value, i) => Math.abs(value - (other[i] ?? 0)) <= SLACK * radiusOf(a.mesh));
}

/** Golden angle: tiles are turned by it, so that the errors of their texels average out. */
const TURN = 2.399963;

/** Returns the rows of the projection along a direction onto the sphere around the scene. @param {Vec3} way towards the light @param {number} i @param {number} radius */
function rowsTowards(way, i, radius) {
  const [u, v] = acrossOf(way, i * TURN);
  return [u, v, way.map((value) => -value)].flatMap((axis) => [...axis.map((value) => value / radius), 0]);
}

/** Returns the matrix of three rows, column by column. @param {number[]} rows */
const matrixOf = (rows) => Float32Array.from({ length: 16 }, (_, at) => (at % 4 < 3 ? (rows[4 * (at % 4) + (at >> 2)] ?? 0) : at === 15 ? 1 : 0));

/** Vertices that the mean colour is computed from; and the share of it that a textured surface is assumed to reflect. */
const [SAMPLED, TEXTURED] = [2000, 0.5];

/** Returns the bounds of a part, relative to the mesh's middle, with some room. @param {MeshPacket} mesh @param {MeshPart} part */
function boxOf(mesh, { first, corners }) {
  const room = ROOM * radiusOf(mesh);
  const extent = extentOf(mesh);
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let i = first; i < first + corners; i++)
    for (let axis = 0; axis < 3; axis++) {
      const value = ((mesh.positions[4 * (mesh.indices[i] ?? 0) + axis] ?? 0) / 65535 - 0.5) * (extent[axis] ?? 0);
      low[axis] = Math.min(low[axis] ?? 0, value - room);
      high[axis] = Math.max(high[axis] ?? 0, value + room);
    }
  return { low, high };
}

/** Room around a part that shines, in radii of the scene. */
const ROOM = 0.01;

/** Returns the mean albedo of a mesh's surfaces. @param {MeshPacket} mesh @returns {Vec3} */
function albedoOf({ colors, indices, parts, materials }) {
  const sum = /** @type {Vec3} */ ([0, 0, 0]);
  let count = 0;
  for (const { first, corners, material } of parts) {
    const { texture } = /** @type {MeshMaterial} */ (materials[material]);
    const share = texture < 0 ? 1 : TEXTURED;
    for (let i = first; i < first + corners; i += Math.max(1, Math.floor(indices.length / SAMPLED))) {
      count++;
      for (const k of /** @type {const} */ ([0, 1, 2])) sum[k] += share * ((colors[4 * (indices[i] ?? 0) + k] ?? 0) / 255) ** 2.2;
    }
  }
  return /** @type {Vec3} */ (sum.map((value) => value / (count || 1)));
}

/** Returns the map of the floor below a scene. @param {Subject} subject */
function floorMap({ mesh, above }) {
  const up = above ?? [0, 1, 0];
  const sizes = up.map(Math.abs);
  const axis = sizes.indexOf(Math.max(...sizes));
  const sign = Math.sign(up[axis] ?? 1);
  const extent = extentOf(mesh);
  const side = 2 * REACH * radiusOf(mesh);
  /** @param {number} i @param {number} value @returns {Vec3} */
  const onAxis = (i, value) => /** @type {Vec3} */ ([0, 1, 2].map((each) => (each === i % 3 ? value : 0)));
  const height = -(extent[axis] ?? 0) / 2;
  const [alongX, alongY] = [onAxis(axis + 1, side), onAxis(axis + 2, side)];
  const corner = onAxis(axis, sign * height).map((value, i) => value - ((alongX[i] ?? 0) + (alongY[i] ?? 0)) / 2);
  return { corner, alongX, alongY, above: onAxis(axis, sign), height, floorX: onAxis(axis + 1, 1 / side), floorY: onAxis(axis + 2, 1 / side) };
}

/** Distance of a lamp, in radii of the scene, from which one tile shows the whole scene. */
const OUTSIDE = 1.15;
/** Nearest and farthest that a tile of a lamp among the scene shows, in radii. */
const [NEAREST, FARTHEST] = [0.004, 8];

/** Returns a lamp's place relative to the mesh's middle, with 1, or its direction, with 0. @param {MeshPacket} mesh @param {Lamp} lamp @returns {number[]} */
function placeOf({ low, high }, { at, far }) {
  return far ? [...unit(at), 0] : [...at.map((value, i) => value - ((low[i] ?? 0) + (high[i] ?? 0)) / 2), 1];
}

/** Returns the tiles that show what each lamp sees. @param {MeshPacket} mesh @param {Lamp[]} lamps @returns {{lamp: number, matrix: number[], texel: number}[]} texel: width of a tile, at distance 1 or of parallel light anywhere */
function lampTilesOf(mesh, lamps) {
  const radius = radiusOf(mesh);
  return lamps
    .flatMap((lamp, number) => {
      const place = /** @type {Vec3} */ (placeOf(mesh, lamp).slice(0, 3));
      if (lamp.far) return [{ lamp: number, matrix: [...matrixOf(rowsTowards(place, number, radius))], texel: 2 * radius }];
      const away = Math.hypot(...place);
      if (away > OUTSIDE * radius) {
        const slope = Math.tan(Math.asin(radius / away));
        return [{ lamp: number, matrix: perspective(place, unit(place.map((value) => -value)), slope, away - radius, away + radius), texel: 2 * slope }];
      }
      return [0, 1, 2].flatMap((axis) =>
        [1, -1].flatMap((sign) => {
          const forward = /** @type {Vec3} */ ([0, 1, 2].map((i) => (i === axis ? sign : 0)));
          if (dot(lamp.axis, lamp.axis) > 0 && dot(lamp.axis, forward) < -0.99) return []; // a lamp that shines to one side
          return [{ lamp: number, matrix: perspective(place, forward, 1, NEAREST * radius, FARTHEST * radius), texel: 2 }];
        }),
      );
    })
    .slice(0, MOST_LAMP_TILES);
}

/** Returns the matrix of a camera, column by column. @param {Vec3} from @param {Vec3} forward unit vector @param {number} slope tangent of half its field of view @param {number} near @param {number} far */
function perspective(from, forward, slope, near, far) {
  const [u, v] = acrossOf(forward, 0);
  const rows = [
    [...u.map((value) => value / slope), -dot(u, from) / slope],
    [...v.map((value) => value / slope), -dot(v, from) / slope],
    [...forward.map((value) => (value * (far + near)) / (far - near)), (-dot(forward, from) * (far + near)) / (far - near) - (2 * far * near) / (far - near)],
    [...forward, -dot(forward, from)],
  ];
  return Array.from({ length: 16 }, (_, at) => rows[at % 4]?.[at >> 2] ?? 0);
}
