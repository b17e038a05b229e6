/**
 * The shadows of a preview mesh: how much of the environment light is blocked at each point, and which part of each lamp's light reaches
 * it. The environment light is sampled by directions, and a depth map is drawn from each, once for a mesh. The maps are looked up at all
 * points that the camera sees, also of the floor below the scene: coarsely at first, then at full resolution; both are smoothed along
 * surfaces. Source: the accumulation of shadow maps of many light samples, Brotman and Badler 1984;
 * Haeberli and Akeley 1990.
 */

import { irradianceAt } from "./mesh-environment.js";
import { FLOOR_TEXELS } from "./mesh-floor-shader.js";
import { sunsOn } from "./mesh-lamps.js";
import { lightSamples, luminance } from "./mesh-light-samples.js";
import { FLOOR_VERTEX } from "./mesh-backdrop-shader.js";
import { VERTEX } from "./mesh-shader.js";
import { BASE, ShadowMaps } from "./mesh-shadow-maps.js";
import { VIEW_DEPTH, VIEW_TEXEL, albedoAxes, extentOf, floorMap, placeOf, radiusOf } from "./mesh-shadow-places.js";
import { FLOOR_NORMAL_FRAGMENT, GATHER_FRAGMENT, GATHER_VERTEX, GIVEN_FRAGMENT, LAMPS_FRAGMENT, NORMAL_FRAGMENT, REFLECTED_FRAGMENT, SMOOTH_FRAGMENT, TILES, TOGETHER } from "./mesh-shadow-shader.js";
import { bindTexture, colorTarget, depthTarget } from "./mesh-targets.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").Lamp} Lamp */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/** @typedef {import("../news/mesh-packet.js").MeshPart} MeshPart */
/** @typedef {import("./mesh-environment.js").LightTables} LightTables */

/**
 * What the floor receives from surfaces above it, in proportion to what they reflect in the light of all directions: the factor, for light that is
 * reflected more than once too, and the power of the light that reaches the floor around, which they see. Chosen by comparison with path-traced pictures.
 */
const [GIVEN, GIVEN_POWER] = [1.2, 0.7];
/** Half the angle between neighbouring ones of all directions, about. */
const APART = 0.09;
/** Light that the blur of shadows may move, in that of a direction. */
const MOST_BLURRED = 0.5;
/** Share of the surrounding light that remains where surfaces block it, if that light only estimates what surfaces reflect. */
const REFLECTED = 0.6;
/** Texture units; those of the mesh are below, of which one is free while nothing is drawn. */
const UNITS = { mapDepth: 5, maps: 9, seenDepth: 10, seenNormal: 11, missed: 12, open: 13, floorMissed: 14, floorAway: 15 };
/** Pixels of the view above which shadows are computed for every other one along a side. */
const MANY_PIXELS = 500_000;
/** Pixels along a side for which the coarse shadows are computed once. */
const COARSE = 3;
/** Time, in milliseconds, that the shadows may take of a frame; and number of tiles that are drawn in a frame, at first and at least. */
const [BUDGET_MS, FEWEST_TILES] = [25, 4];
/** Triangles that the first frame's directions may have together. */
const FIRST_TRIANGLES = 800_000;
/** Directions that are gathered at once at full resolution: about 0.1 s where a processor stands in for a graphics card. */
const SLICE = 8;
/** Levels of the floor's textures. */
const LEVELS = Math.floor(Math.log2(FLOOR_TEXELS)) + 1;
/** Directions of the first frame. */
const FIRST_TILES = 32;
/** Difference of two scenes' extents, of their size, up to which they have the same shape. */
const SLACK = 1e-4;

/** @typedef {(name: string) => WebGLUniformLocation | null} At */
/** What a frame of shadows is drawn for. @typedef {{mesh: MeshPacket, tables: LightTables, lamps: Lamp[], above: Vec3 | null, isAlone: boolean, drawPart: (part: MeshPart, material: MeshMaterial, at: At) => void}} Subject isAlone: whether only lamps light it. above: up in the scene, if it stands on a floor */
/** What the camera sees, with normals as EDGED_GLSL has them and smoothed ones, and the light that misses it: added up coarsely and finely, and smoothed. @typedef {{width: number, height: number, depth: WebGLTexture, normal: WebGLTexture, smoothed: WebGLTexture, coarse: Gathered, fine: Gathered, missed: WebGLTexture, open: WebGLTexture}} Seen */
/** The light that is hidden from points, what surfaces reflect in its place, how far these are, and what remains missing. @typedef {{hidden: WebGLTexture, given: WebGLTexture, away: WebGLTexture, missed: WebGLTexture}} Gathered */
/** Textures of the floor's map: the light that it misses, and how far what shadows it is; and of what these are computed from, the light that is hidden, that which is reflected in its place, and the parts of the lamps' light. @typedef {{missed: WebGLTexture, away: WebGLTexture, hidden: WebGLTexture, given: WebGLTexture, open: WebGLTexture, reflected: WebGLTexture}} Floor */

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
    /** What white surfaces reflect in place of each sample's light. @type {number[]} */
    this.instead = [];
    /** The same of surfaces in the light of lamps that are far away. @type {number[]} */
    this.insteadInSun = [];
    /** @type {ShadowMaps | null} */
    this.maps = null;
    /** @type {Floor | null} */
    this.floor = null;
    /** Directions that the floor's map, and the camera's fine shadows have. */
    this.onFloor = this.fine = 0;
    /** Whether the scene's albedo is drawn with the textures that have arrived. */
    this.areColorsKnown = false;
    this.tilesAtOnce = FEWEST_TILES;
    /** @type {Float32Array<ArrayBuffer> | null} */
    this.toClip = null;
    /** @type {Seen | null} */
    this.seen = null;
    /** Set once the work of the last frame is done, and when it began. @type {WebGLSync | null} */
    this.fence = null;
    this.begun = 0;
    /** @type {WebGLFramebuffer | null} */
    this.frame = null;
  }

  /** Whether nothing is left to do. */
  get isDone() {
    return !this.isPossible || !this.subject || this.fine === this.samples.length;
  }

  /** Angle between neighbouring directions that the floor's map has, in proportion to that of all. */
  get floorSpread() {
    return Math.sqrt(Math.max(1, this.samples.length / (this.onFloor || 1)));
  }

  /** Begins the shadows of another mesh, or of another light; those of the same shape, which the service has read too, stay. @param {Subject} subject */
  begin(subject) {
    const { gl } = this;
    const isAlike = this.subject !== null && isSameShape(this.subject, subject);
    this.subject = subject;
    this.toClip = null;
    const { tables } = subject;
    this.maps ??= new ShadowMaps(gl, (vertex, fragment) => this.program(vertex, fragment));
    if (!isAlike) this.samples = lightSamples(/** @type {LightTables["levels"][number]} */ (tables.levels[0]), TILES);
    this.maps.begin(subject, this.samples, isAlike);
    if (isAlike) return;
    this.areColorsKnown = false;
    this.instead = this.samples.flatMap(({ way, weight, color }) => {
      if (subject.isAlone) return color.map((value) => REFLECTED * value);
      const received = irradianceAt(tables.irradiance, /** @type {Vec3} */ (way.map((value) => -value)));
      return received.map((value) => weight * value);
    });
    this.insteadInSun = this.samples.flatMap(({ way, weight }, i) => sunsOn(/** @type {Vec3} */ (way.map((value) => -value)), subject.lamps).map((value, k) => (this.instead[3 * i + k] ?? 0) + weight * value));
    this.onFloor = this.fine = 0;
    if (!this.floor) {
      const target = (/** @type {number} */ format, levels = LEVELS) => colorTarget(gl, FLOOR_TEXELS, FLOOR_TEXELS, format, levels);
      gl.activeTexture(gl.TEXTURE0 + UNITS.floorMissed);
      this.floor = { missed: target(gl.RGBA16F), away: target(gl.RG16F), hidden: target(gl.RGBA16F), given: target(gl.RGBA16F), open: target(gl.RGBA8), reflected: target(gl.RGBA16F, 1) };
    }
    this.clearFloor();
    this.mipmap(this.floor.missed, this.floor.away);
  }

  /** Draws the maps that the first frame is shown with, fewer where there are many triangles. */
  drawFirst() {
    const { subject, maps } = this;
    if (!maps || (maps.drawn && this.areColorsKnown) || !this.samples.length || !subject) return;
    maps.drawAlbedos();
    this.areColorsKnown = true;
    if (subject.above) maps.drawBase();
    if (!maps.drawn) maps.drawDirections(Math.min(FIRST_TILES, Math.max(FEWEST_TILES, Math.floor(FIRST_TRIANGLES / subject.mesh.triangles))));
    this.gatherFloor();
  }

  /** Begins anew: the texture of a surface that is partly transparent has arrived. */
  renew() {
    const { subject } = this;
    this.subject = null;
    if (subject) this.begin(subject);
  }

  /** Computes anew what surfaces reflect: the texture of one has arrived. */
  recolor() {
    this.areColorsKnown = false;
    this.toClip = null;
  }

  /**
   * Takes what another camera sees.
   *
   * @param {Float32Array<ArrayBuffer>} toClip
   * @param {number[]} eye as the mesh's shaders have it
   * @param {{width: number, height: number}} size of the canvas
   */
  follow(toClip, eye, size) {
    const { gl, subject, maps } = this;
    if (!subject || !maps) return;
    const share = size.width * size.height > MANY_PIXELS ? 2 : 1;
    const [width, height] = [Math.ceil(size.width / share), Math.ceil(size.height / share)];
    const isSame = this.seen?.width === width && this.seen.height === height && this.toClip?.every((value, i) => value === toClip[i]);
    if (isSame) return;
    if (this.seen?.width !== width || this.seen.height !== height) this.resize(width, height);
    this.toClip = Float32Array.from(toClip);
    this.fine = 0;
    this.drawSeen(eye);
    this.drawFirst();
    if (this.seen) this.gatherLamps(this.seen.open, 1);
    this.gatherFirst();
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** @param {number} width @param {number} height */
  resize(width, height) {
    const { gl } = this;
    if (this.seen) for (const texture of Object.values(this.seen).flatMap((each) => (each instanceof WebGLTexture ? each : typeof each === "object" ? Object.values(each) : []))) gl.deleteTexture(texture);
    gl.activeTexture(gl.TEXTURE0 + UNITS.missed);
    const colors = (/** @type {number} */ format, share = 1) => colorTarget(gl, Math.ceil(width / share), Math.ceil(height / share), format);
    const gathered = (share = 1) => ({ hidden: colors(gl.RGBA16F, share), given: colors(gl.RGBA16F, share), away: colors(gl.RG16F, share), missed: colors(gl.RGBA16F, share) });
    this.seen = { width, height, depth: depthTarget(gl, width, height, gl.DEPTH_COMPONENT24), normal: colors(gl.RGBA8), smoothed: colors(gl.RGBA8), coarse: gathered(COARSE), fine: gathered(), missed: colors(gl.RGBA16F), open: colors(gl.RGBA8) };
  }

  /** Draws depth and normals of what the camera sees. @param {number[]} eye */
  drawSeen(eye) {
    const { gl, seen, maps, subject, toClip } = this;
    const linked = this.program(VERTEX, NORMAL_FRAGMENT);
    if (!seen || !linked || !maps || !subject || !toClip) return;
    this.target(seen.normal, seen.width, seen.height);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT1, gl.TEXTURE_2D, seen.smoothed, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, seen.depth, 0);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(linked.program);
    gl.uniform1f(linked.at("threshold"), 0.5);
    gl.uniform4fv(linked.at("eye"), eye);
    maps.drawSolids(linked, toClip, ({ transmission, alpha_mode: mode }) => (transmission > 0 || mode === "blend" ? 0 : 1));
    const floor = subject.above && this.program(FLOOR_VERTEX, FLOOR_NORMAL_FRAGMENT);
    if (floor) {
      gl.useProgram(floor.program);
      gl.uniformMatrix4fv(floor.at("toClip"), false, toClip);
      this.placeFloor(floor.at);
      gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    }
    for (const each of [gl.COLOR_ATTACHMENT1, gl.DEPTH_ATTACHMENT]) gl.framebufferTexture2D(gl.FRAMEBUFFER, each, gl.TEXTURE_2D, null, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0]);
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
    const { gl, maps } = this;
    if (this.isDone || !maps || !this.toClip) return false;
    if (this.fence) {
      const isOver = gl.clientWaitSync(this.fence, 0, 0) !== gl.TIMEOUT_EXPIRED;
      if (!isOver) return false;
      gl.deleteSync(this.fence);
      this.fence = null;
      const took = performance.now() - this.begun;
      if (took > 2 * BUDGET_MS) this.tilesAtOnce = Math.max(FEWEST_TILES, this.tilesAtOnce / 2);
      else if (took < BUDGET_MS) this.tilesAtOnce = Math.min(TILES, this.tilesAtOnce * 2);
    }
    this.begun = performance.now();
    if (maps.drawn < this.samples.length) {
      maps.drawDirections(this.tilesAtOnce);
      if (maps.drawn === this.samples.length) this.gatherFloor();
    } else {
      for (let i = 0; i < Math.max(1, this.tilesAtOnce / SLICE) && !this.isDone; i++) this.gatherMore();
      if (this.isDone && this.seen) this.smooth(this.seen.fine, 1);
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    return this.isDone;
  }

  /** Gathers all directions that are drawn for the floor's map. */
  gatherFloor() {
    const { maps, floor, subject } = this;
    if (!maps || !floor || !subject?.above) return;
    this.clearFloor();
    for (let first = 0; first < maps.drawn; first += TOGETHER) this.gather(floor, first, 0);
    this.onFloor = maps.drawn;
    if (subject.lamps.some(({ far }) => far)) this.gatherLamps(floor.open, 0);
    this.mipmap(floor.hidden, floor.away, floor.given, floor.open);
    this.composeFloor(floor);
    this.mipmap(floor.missed);
  }

  /** Computes the light that the floor misses from what is gathered. @param {Floor} floor */
  composeFloor(floor) {
    const { gl, maps, subject } = this;
    const linked = this.program(GATHER_VERTEX, GIVEN_FRAGMENT);
    if (!linked || !maps || !subject) return;
    const { at } = linked;
    this.target(floor.missed, FLOOR_TEXELS, FLOOR_TEXELS);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT1, gl.TEXTURE_2D, floor.reflected, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1]);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.useProgram(linked.program);
    for (const [name, unit, texture] of /** @type {const} */ ([
      ["hidden", UNITS.missed, floor.hidden],
      ["given", UNITS.open, floor.given],
      ["openSuns", UNITS.floorMissed, floor.open],
      ["under", UNITS.seenDepth, maps.sides],
      ["floorAway", UNITS.floorAway, floor.away],
    ])) {
      gl.uniform1i(at(name), unit);
      bindTexture(gl, unit, texture);
    }
    gl.uniform1f(at("most"), subject.isAlone ? 1 : GIVEN);
    gl.uniform1f(at("power"), subject.isAlone ? 0 : GIVEN_POWER);
    gl.uniform1f(at("texelWidth"), VIEW_TEXEL);
    gl.uniform1f(at("perDepth"), VIEW_DEPTH);
    gl.uniform1f(at("ground"), 0.5 + (0.5 * floorMap(subject).height) / radiusOf(subject.mesh));
    gl.uniform4fv(at("suns"), sunShares(subject));
    gl.uniform1f(at("softness"), this.floorSpread * APART * FLOOR_TEXELS * Math.hypot(...floorMap(subject).floorX));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT1, gl.TEXTURE_2D, null, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0]);
  }

  /** Gathers the first directions for the camera, coarsely: in each frame while it turns. */
  gatherFirst() {
    const { maps, seen } = this;
    if (!maps || !seen) return;
    this.clearGathered(seen.coarse);
    for (let first = 0; first < Math.min(maps.drawn, FIRST_TILES); first += TOGETHER) this.gather(seen.coarse, first, COARSE);
    this.smooth(seen.coarse, COARSE);
  }

  /** Gathers further directions for the camera, finely. */
  gatherMore() {
    const { seen } = this;
    if (!seen) return;
    if (!this.fine) this.clearGathered(seen.fine);
    this.gather(seen.fine, this.fine, 1, SLICE);
    this.fine = Math.min(this.fine + SLICE, this.samples.length);
  }

  /** Adds up what the light of some directions misses. @param {Pick<Gathered, "hidden" | "given" | "away">} target @param {number} first @param {number} step pixels that a texel of the target stands for; 0: it is the floor's map @param {number} [most] directions, TOGETHER at most */
  gather(target, first, step, most = TOGETHER) {
    const { gl, maps, samples, seen, subject } = this;
    const linked = this.program(GATHER_VERTEX, GATHER_FRAGMENT, step ? [] : ["FLOOR"]);
    if (!maps || !linked || !subject) return;
    const { at } = linked;
    const last = Math.min(first + most, maps.drawn);
    this.beginPoints(linked, target.hidden, step);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT1, gl.TEXTURE_2D, target.given, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT2, gl.TEXTURE_2D, target.away, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0, gl.COLOR_ATTACHMENT1, gl.COLOR_ATTACHMENT2]);
    maps.bind(UNITS.maps, maps.directions);
    maps.bind(UNITS.mapDepth, maps.directions);
    gl.bindSampler(UNITS.mapDepth, maps.uncompared);
    gl.uniform1i(at("mapDepth"), UNITS.mapDepth);
    gl.uniform1f(at("depthRange"), 2 * radiusOf(subject.mesh));
    gl.uniform1i(at("first"), first);
    gl.uniform1i(at("count"), last - first);
    gl.uniform1f(at("texelSize"), maps.texelSize);
    maps.bind(UNITS.missed, maps.albedos);
    gl.uniform1i(at("albedos"), UNITS.missed);
    const [albedoX, albedoY] = albedoAxes(subject);
    gl.uniform3fv(at("albedoX"), albedoX);
    gl.uniform3fv(at("albedoY"), albedoY);
    gl.uniform1f(at("halfHeight"), extentOf(subject.mesh).reduce((sum, value, i) => sum + value * Math.abs(floorMap(subject).above[i] ?? 0), 0) / 2);
    gl.uniform1i(at("isAlone"), subject.isAlone ? 1 : 0);
    gl.uniform4fv(at("rows"), maps.rows.slice(first, last).flat());
    gl.uniform3fv(at("ways"), samples.slice(first, last).flatMap(({ way }) => way));
    gl.uniform3fv(at("colors"), samples.slice(first, last).flatMap(({ color }) => color));
    gl.uniform3fv(at("instead"), (step ? this.instead : this.insteadInSun).slice(3 * first, 3 * last));
    if (step) {
      this.setFloor(at);
      gl.uniform1i(at("floorReflected"), UNITS.floorAway);
      bindTexture(gl, UNITS.floorAway, this.floor?.reflected ?? null);
      gl.uniform1i(at("seenSmoothed"), UNITS.open);
      bindTexture(gl, UNITS.open, seen?.smoothed ?? null);
    } else {
      gl.uniform1i(at("under"), UNITS.open);
      maps.bind(UNITS.open, maps.sides);
    }
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
    gl.enable(gl.DEPTH_TEST);
    gl.bindSampler(UNITS.mapDepth, null);
    for (const each of [gl.COLOR_ATTACHMENT1, gl.COLOR_ATTACHMENT2]) gl.framebufferTexture2D(gl.FRAMEBUFFER, each, gl.TEXTURE_2D, null, 0);
    gl.drawBuffers([gl.COLOR_ATTACHMENT0]);
  }

  /** @param {Gathered} gathered */
  clearGathered({ hidden, given, away }) {
    for (const each of [hidden, given, away]) this.clear(each, 0);
  }

  clearFloor() {
    for (const texture of Object.values(this.floor ?? {})) this.clear(texture, 0);
  }

  /** Computes the light that what the camera sees misses, and blurs it along the surfaces. @param {Gathered} gathered @param {number} step pixels that a texel of it stands for */
  smooth(gathered, step) {
    const { gl, samples, seen, subject } = this;
    const [reflected, linked] = [this.program(GATHER_VERTEX, REFLECTED_FRAGMENT), this.program(GATHER_VERTEX, SMOOTH_FRAGMENT)];
    if (!seen || !subject || !reflected || !linked) return;
    this.beginPoints(reflected, gathered.missed, step);
    gl.uniform1i(reflected.at("isAlone"), subject.isAlone ? 1 : 0);
    gl.uniform1i(reflected.at("hidden"), UNITS.missed);
    bindTexture(gl, UNITS.missed, gathered.hidden);
    gl.uniform1i(reflected.at("given"), UNITS.open);
    bindTexture(gl, UNITS.open, gathered.given);
    gl.uniform1i(reflected.at("hiddenAway"), UNITS.floorAway);
    bindTexture(gl, UNITS.floorAway, gathered.away);
    gl.uniform1f(reflected.at("most"), MOST_BLURRED * luminance(...(samples[0]?.color ?? [0, 0, 0])));
    gl.uniform1f(reflected.at("softness"), APART);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    this.beginPoints(linked, seen.missed, 1);
    gl.uniform1i(linked.at("step"), step);
    gl.uniform1i(linked.at("raw"), UNITS.missed);
    bindTexture(gl, UNITS.missed, gathered.missed);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }

  /** Finds out where the lamps are seen. @param {WebGLTexture} target @param {number} step as beginPoints has it */
  gatherLamps(target, step) {
    const { gl, maps, subject } = this;
    if (!maps || !subject) return;
    const { lampTiles } = maps;
    if (!lampTiles.length) {
      this.clear(target, 1);
      return;
    }
    maps.drawLamps();
    const linked = this.program(GATHER_VERTEX, LAMPS_FRAGMENT, step ? [] : ["FLOOR"]);
    if (!linked) return;
    const { at } = linked;
    const { across, side, filled } = maps.lampGrid;
    this.beginPoints(linked, target, step);
    maps.bind(UNITS.maps, maps.lamps);
    gl.uniform1i(at("count"), lampTiles.length);
    gl.uniform1i(at("across"), across);
    // The tiles fill the map but for a remainder of texels.
    gl.uniform1f(at("texelWidth"), 1 / side);
    gl.uniform1f(at("filled"), filled);
    gl.uniformMatrix4fv(at("toTile"), false, lampTiles.flatMap(({ matrix }) => matrix));
    gl.uniform2fv(at("lampOf"), lampTiles.flatMap(({ lamp, texel }) => [lamp, texel / side]));
    gl.uniform4fv(at("places"), subject.lamps.flatMap((lamp) => placeOf(subject.mesh, lamp)));
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }

  /** Begins to compute something for many points. @param {import("./mesh-program.js").Linked} linked @param {WebGLTexture} target @param {number} step pixels of what the camera sees that a texel stands for; 0: points of the floor's map */
  beginPoints({ program, at }, target, step) {
    const { gl, maps, seen, subject } = this;
    if (!maps || !seen || !subject) return;
    if (step) this.target(target, Math.ceil(seen.width / step), Math.ceil(seen.height / step));
    else this.target(target, FLOOR_TEXELS, FLOOR_TEXELS);
    gl.disable(gl.DEPTH_TEST);
    gl.disable(gl.BLEND);
    gl.useProgram(program);
    gl.uniform1i(at("maps"), UNITS.maps);
    if (!step) {
      this.placeFloor(at);
      gl.uniform3fv(at("above"), floorMap(subject).above);
      gl.uniform1f(at("thick"), BASE * radiusOf(subject.mesh));
      gl.uniform1i(at("base"), UNITS.seenDepth);
      maps.bind(UNITS.seenDepth, maps.base);
      return;
    }
    gl.uniformMatrix4fv(at("toClip"), false, /** @type {Float32Array<ArrayBuffer>} */ (this.toClip));
    gl.uniform1i(at("step"), step);
    gl.uniform1i(at("seenDepth"), UNITS.seenDepth);
    gl.uniform1i(at("seenNormal"), UNITS.seenNormal);
    bindTexture(gl, UNITS.seenDepth, seen.depth);
    bindTexture(gl, UNITS.seenNormal, seen.normal);
  }

  /** @param {WebGLTexture} texture @param {number} width @param {number} height */
  target(texture, width, height) {
    const { gl, maps } = this;
    if (!maps) return;
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame ??= gl.createFramebuffer());
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, texture, 0);
    gl.viewport(0, 0, width, height);
  }

  /** Sets where the floor's map is. @param {At} at */
  placeFloor(at) {
    const { gl, subject } = this;
    if (!subject) return;
    const { corner, alongX, alongY } = floorMap(subject);
    gl.uniform3fv(at("corner"), corner);
    gl.uniform3fv(at("alongX"), alongX);
    gl.uniform3fv(at("alongY"), alongY);
  }

  /** Sets what FLOOR_MAP_GLSL reads. @param {At} at */
  setFloor(at) {
    const { gl, floor: map, subject } = this;
    if (!subject) return;
    const { above, height, floorX, floorY } = floorMap(subject);
    const floor = subject.tables.floor;
    gl.uniform4fv(at("floorPlane"), subject.above ? [...above, height] : [0, 0, 0, 0]);
    gl.uniform3fv(at("floorX"), floorX);
    gl.uniform3fv(at("floorY"), floorY);
    gl.uniform1f(at("floorAlbedo"), floor?.albedo ?? 0);
    gl.uniform3fv(at("floorRadiance"), floor?.radiance ?? [1, 1, 1]);
    gl.uniform1i(at("floorMissed"), UNITS.floorMissed);
    bindTexture(gl, UNITS.floorMissed, map?.missed ?? null);
  }

  /** Sets what the shaders of the mesh and of the floor read. @param {At} at @param {{width: number, height: number}} size of the canvas */
  bind(at, { width, height }) {
    const { gl, seen } = this;
    if (!seen) return;
    this.setFloor(at);
    gl.uniform2f(at("perPixel"), 1 / width, 1 / height);
    gl.uniform1i(at("missedLight"), UNITS.missed);
    gl.uniform1i(at("openLamps"), UNITS.open);
    gl.uniform1i(at("seenDepth"), UNITS.seenDepth);
    gl.uniform1i(at("seenNormal"), UNITS.seenNormal);
    bindTexture(gl, UNITS.seenNormal, seen.normal);
    bindTexture(gl, UNITS.missed, seen.missed);
    bindTexture(gl, UNITS.open, seen.open);
    bindTexture(gl, UNITS.seenDepth, seen.depth);
  }

  /** @param {WebGLTexture} texture @param {number} value */
  clear(texture, value) {
    const { gl } = this;
    this.target(texture, 1, 1);
    gl.clearColor(value, value, value, value);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
  }

  /** @param {WebGLTexture[]} textures of the floor */
  mipmap(...textures) {
    const { gl } = this;
    for (const texture of textures) {
      bindTexture(gl, UNITS.floorMissed, texture);
      gl.generateMipmap(gl.TEXTURE_2D);
    }
  }
}

/** Returns the parts of a floor's light that come from each of four lamps, if these are far away. @param {Subject} subject */
function sunShares({ tables, lamps, above }) {
  const { radiance = [0, 0, 0], albedo = 0 } = tables.floor ?? {};
  const suns = [0, 1, 2, 3].map((i) => (lamps[i] && above ? albedo * luminance(...sunsOn(above, [/** @type {Lamp} */ (lamps[i])])) : 0));
  const all = suns.reduce((sum, value) => sum + value, luminance(.../** @type {Vec3} */ (radiance)));
  return suns.map((value) => value / (all || 1));
}

/** Returns whether two scenes cast the same shadows, but for textures. @param {Subject} a @param {Subject} b */
function isSameShape(a, b) {
  if (a.tables !== b.tables || a.mesh.triangles !== b.mesh.triangles || String(a.above) !== String(b.above) || JSON.stringify(a.lamps) !== JSON.stringify(b.lamps)) return false;
  const [extent, other] = [extentOf(a.mesh), extentOf(b.mesh)];
  return extent.every((value, i) => Math.abs(value - (other[i] ?? 0)) <= SLACK * radiusOf(a.mesh));
}

