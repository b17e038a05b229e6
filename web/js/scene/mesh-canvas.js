/** Draws a scene's preview mesh with WebGL: shaded triangles, seen by the camera of the live view. */

import { curveIndex } from "../film/film-shader.js";
import { DEFAULT_CURVE } from "../film/tonemap.js";
import { KeptPicture, fromMiddle } from "./kept-picture.js";
import { cameraAxes, clipMatrix } from "./mesh-camera.js";
import { chosenLight, isComputable } from "./chosen-light.js";
import { lampsOf, rectanglesOf, sunsOn } from "./mesh-lamps.js";
import { MIRROR_UNITS, MeshMirrors, isMirror } from "./mesh-mirror.js";
import { placeOf } from "./mesh-parts.js";
import { Programs } from "./mesh-program.js";
import { BACKDROP_FRAGMENT, BACKDROP_VERTEX, FLOOR_FRAGMENT, FLOOR_VERTEX } from "./mesh-backdrop-shader.js";
import { MOST_LAMPS } from "./mesh-light-shader.js";
import { DENSE_FRAGMENT, DENSE_VERTEX, FRAGMENT, PASS, PLACES, VERTEX } from "./mesh-shader.js";
import { FLOOR_REACH, floorMap, floorReach } from "./mesh-shadow-places.js";
import { MeshShadows } from "./mesh-shadow.js";
import { LIT_SAMPLE, SAMPLE, SAMPLE_VIEW } from "./mesh-sample.js";
import { aroundTexture, fillTexel, fillTexture, standInOf, tablesOf, texelTexture } from "./mesh-textures.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/** @typedef {import("../news/mesh-packet.js").MeshPart} MeshPart */
/** @typedef {import("./mesh-parts.js").Place & {part: MeshPart, material: MeshMaterial, showsScene: boolean}} DrawnPart */

const MAX_RATIO = 2;
/** Share of the resolution along a side with which the first frame and those of a moving camera are drawn without a graphics card; time, in milliseconds, from the last of them to one of full resolution. */
const [COARSE_RATIO, SETTLED_MS] = [0.5, 150];
/** Time, in milliseconds, that a mesh waits for its textures: what was drawn before stays meanwhile. */
const HELD_MS = 400;
/** Texture units of the mesh: the projected picture has 1 to 4 (kept-picture.js), shadows 10 to 15; a program has one of them at most. */
const UNITS = { image: 0, roughMetal: 5, glow: 6, around: 7, behind: 8, mirrored: MIRROR_UNITS.color };
const ALPHA_MODES = { opaque: 0, mask: 1, blend: 2 };
/** Roughness of glass from which what is behind it is blurred. */
const BLURRED = 0.05;

/** Triangles of a mesh whose first frame has shadows also without a graphics card: these draw all of them eight times. */
const SHADOWED_AT_ONCE = 100_000;

export class MeshCanvas {
  /** @param {HTMLCanvasElement} canvas as large as its box */
  constructor(canvas) {
    this.canvas = canvas;
    /** Whether the scene stands on the studio's floor; "auto": if the studio lights it, and none of its surfaces shines. @type {boolean | "auto"} */
    this.floor = false;
    /** Upward in the scene. @type {Vec3} */
    this.above = [0, 1, 0];
    /** @type {MeshPacket | null} */
    this.mesh = null;
    /** @type {View | null} */
    this.view = null;
    /** Factor of the light, and the number of the tone curve. */
    this.look = { gain: 1, curve: curveIndex(DEFAULT_CURVE) };
    /** A picture without noise, which is projected onto the mesh. @type {KeptPicture | null} */
    this.kept = null;
    /** What has projected a picture, for the next one: its programs take long to compile. @type {KeptPicture | null} */
    this.projector = null;
    this.pending = 0;
    /** Ends the wait for textures. @type {ReturnType<typeof setTimeout> | undefined} */
    this.held = undefined;
    /** Fulfilled once the mesh waits no more. @type {Promise<void>} */
    this.ready = Promise.resolve();
    /** The next frame in which shadows are computed. */
    this.refining = 0;
    this.gl = canvas.getContext("webgl2", { alpha: true, antialias: true, depth: true });
    /** Whether frames take a tenth of a second or more. */
    this.isSlow = this.gl !== null && isSoftware(this.gl);
    /** Whether the view's samples are being rendered, perhaps by the cores that would refine the shadows where drawing is slow. */
    this.isReplacedSoon = false;
    /** Whether a first frame is drawn, which does without what takes long: mirrors show only the light around the scene, and large meshes have no shadows. */
    this.isFirst = false;
    /** Ends the coarse frames. @type {ReturnType<typeof setTimeout> | undefined} */
    this.settling = undefined;
    /** @type {Programs | null} */
    this.programs = this.gl && new Programs(this.gl);
    this.shadows = this.gl && this.programs && new MeshShadows(this.gl, this.programs);
    /** Finds the uniforms of the program in use. @type {(name: string) => WebGLUniformLocation | null} */
    this.at = () => null;
    /** By number; the last is white. @type {WebGLTexture[]} */
    this.textures = [];
    /** Vertices and indices of the mesh. @type {WebGLBuffer[]} */
    this.buffers = [];
    /** The light around, and for which floor it was computed. @type {{texture: WebGLTexture, irradiance: Float32Array, lamps: import("../news/mesh-packet.js").Lamp[], rectangles: (import("./mesh-lamps.js").Rectangle | null)[], hasFloor: boolean, above: Vec3, isBlack: boolean, floor: import("./mesh-environment.js").LightTables["floor"], below: WebGLTexture | null} | null} below: the light around below the floor, once it was seen */
    this.light = null;
    /** The light that the request chooses. @type {import("../base/types.js").EnvironmentRequest} */
    this.chosen = {};
    /** What is drawn before glass. @type {WebGLTexture | null} */
    this.behind = null;
    this.mirrors = this.gl && new MeshMirrors(this.gl);
    /** Of the parts. @type {import("./mesh-parts.js").Place[]} */
    this.places = [];
    this.resizing = new ResizeObserver(() => this.invalidate());
    this.resizing.observe(canvas);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.projector = this.light = this.behind = null; // they were lost too
      this.mirrors = this.gl && new MeshMirrors(this.gl);
      this.programs = this.gl && new Programs(this.gl);
      this.shadows = this.gl && this.programs && new MeshShadows(this.gl, this.programs);
      if (this.mesh) this.setMesh(this.mesh);
    });
  }

  /** Compiles what many uploads need, before the first mesh, by drawing: many drivers compile no sooner. @param {boolean} hasLamps whether it is for scenes with lamps */
  compile(hasLamps) {
    const { gl, canvas, floor } = this;
    if (!gl || this.mesh || gl.isContextLost()) return;
    this.floor = true;
    const sample = hasLamps ? LIT_SAMPLE : SAMPLE;
    this.setMesh(sample);
    this.drawMesh(clipMatrix(SAMPLE_VIEW, 1, SAMPLE.low, SAMPLE.high), sample, SAMPLE_VIEW, null, { width: canvas.width, height: canvas.height });
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.flush();
    this.floor = floor;
    this.mesh = null;
  }

  /** @param {MeshPacket} mesh */
  setMesh(mesh) {
    const { gl } = this;
    this.mesh = mesh;
    if (!isComputable(mesh, this.chosen)) this.chosen = {}; // its own light until the chosen one arrives
    this.release();
    if (!gl || gl.isContextLost()) return; // the picture comes without a preview
    this.places = mesh.parts.map((part) => placeOf(mesh, part));
    gl.enable(gl.DEPTH_TEST);
    for (const each of this.buffers.splice(0)) gl.deleteBuffer(each); // of an earlier mesh
    for (const each of this.textures) gl.deleteTexture(each);
    this.forgetLight();
    this.mirrors?.forget();
    /** @param {number} target @param {any} data */
    const fill = (target, data) => {
      const buffer = gl.createBuffer();
      this.buffers.push(buffer);
      gl.bindBuffer(target, buffer);
      gl.bufferData(target, data, gl.STATIC_DRAW);
    };
    /** @param {number} at its location @param {any} data @param {number} size @param {number} type */
    const attribute = (at, data, size, type) => {
      fill(gl.ARRAY_BUFFER, data);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, type, true, type === gl.UNSIGNED_SHORT || type === gl.FLOAT ? 8 : 4, 0);
    };
    attribute(PLACES.share, mesh.positions, 3, gl.UNSIGNED_SHORT);
    attribute(PLACES.normal, mesh.normals, 3, gl.BYTE);
    attribute(PLACES.color, mesh.colors, 4, gl.UNSIGNED_BYTE);
    if (mesh.uvs) attribute(PLACES.uv, mesh.uvs, 2, gl.FLOAT);
    else gl.disableVertexAttribArray(PLACES.uv);
    fill(gl.ELEMENT_ARRAY_BUFFER, mesh.indices);
    gl.activeTexture(gl.TEXTURE0);
    this.textures = [...mesh.textures.map((_, number) => texelTexture(gl, standInOf(number, mesh.materials))), texelTexture(gl)];
    this.hold(mesh);
    const data = new Set(mesh.materials.map((material) => material.metallic_roughness_texture));
    mesh.textures.forEach(({ image, sampler }, number) =>
      void image.then((arrived) => {
        if (this.mesh !== mesh || gl.isContextLost()) return;
        gl.activeTexture(gl.TEXTURE0);
        if (arrived) fillTexture(gl, this.textures[number] ?? null, arrived, sampler, data.has(number));
        else fillTexel(gl, this.textures[number] ?? null);
        const shown = mesh.materials.filter(({ texture }) => texture === number);
        if (shown.some(({ alpha_mode: mode }) => mode !== "opaque")) this.shadows?.renew();
        else if (shown.length) this.shadows?.recolor();
        this.mirrors?.forget();
        this.canvas.dataset.textures = String(Number(this.canvas.dataset.textures ?? 0) + 1);
        this.invalidate();
      }),
    );
    this.invalidate();
  }

  /** Whether the mesh is not drawn yet, since it waits for its textures. */
  get isWaiting() {
    return this.held !== undefined;
  }

  /** Waits for the textures of a mesh, for HELD_MS at most. @param {MeshPacket} mesh */
  hold(mesh) {
    clearTimeout(this.held);
    this.held = undefined;
    if (!mesh.textures.length) {
      this.ready = Promise.resolve();
      return;
    }
    const all = Promise.allSettled(mesh.textures.map(({ image }) => image));
    const late = new Promise((resolve) => (this.held = setTimeout(resolve, HELD_MS)));
    const { held } = this;
    this.ready = Promise.race([all, late]).then(() => {
      if (this.held !== held) return; // another mesh waits
      clearTimeout(held);
      this.held = undefined;
      this.invalidate();
    });
  }

  /** @param {import("../base/types.js").Scene} scene */
  setScene({ cameras, status, has_floor: hasFloor, floor }) {
    this.above = cameras.at(-1)?.view.up ?? this.above; // the automatic camera's
    this.floor = status === "ready" ? Boolean(hasFloor) : floor === "on" || (floor === "auto" && "auto");
    this.invalidate();
  }

  /** Lights the mesh as a request chooses. Returns false if the page cannot compute that light. @param {import("../base/types.js").EnvironmentRequest} chosen */
  relight(chosen) {
    if (!this.mesh || !isComputable(this.mesh, chosen)) return false;
    if (JSON.stringify(chosen) === JSON.stringify(this.chosen)) return true;
    this.chosen = chosen;
    this.forgetLight();
    this.invalidate();
    return true;
  }

  forgetLight() {
    for (const texture of this.light ? [this.light.texture, this.light.below] : []) this.gl?.deleteTexture(texture);
    this.light = null;
  }

  get hasFloor() {
    if (this.floor !== "auto") return this.floor;
    return Boolean(this.mesh?.isStudio) && !this.mesh?.materials.some(({ emission }) => Math.max(...emission) > 0);
  }

  /** @param {View} view */
  setView(view) {
    this.view = view;
    this.drawCoarsely();
    this.invalidate();
  }

  /** @param {boolean} is whether samples are being rendered that will replace the mesh */
  expect(is) {
    if (is === this.isReplacedSoon) return;
    this.isReplacedSoon = is;
    if (!is && this.isRefining) this.invalidate();
  }

  /** Draws coarsely until nothing has changed for SETTLED_MS, where drawing is slow. */
  drawCoarsely() {
    if (!this.isSlow) return;
    clearTimeout(this.settling);
    this.settling = setTimeout(() => {
      this.settling = undefined;
      this.invalidate();
    }, SETTLED_MS);
  }

  /** @param {{exposure: number, curve: string}} look exposure: in stops */
  setLook({ exposure, curve }) {
    this.look = { gain: 2 ** exposure, curve: curveIndex(curve) };
    this.invalidate();
  }

  /**
   * Projects a picture onto the mesh from now on.
   *
   * @param {HTMLCanvasElement | HTMLImageElement} picture
   * @param {View} view its camera
   */
  keep(picture, view) {
    if (!this.gl || !this.mesh || this.gl.isContextLost()) return;
    this.kept = this.projector ??= new KeptPicture(this.gl);
    this.kept.set(picture, view);
    this.draw(); // at once: it replaces the picture on the page
    this.invalidate();
  }

  /** Projects no picture any more, and frees its textures. */
  release() {
    this.kept?.clear();
    this.kept = null;
  }

  /** How far the camera is from that of the projected picture, 0 ... 1; 1 without one. */
  get distance() {
    return (this.view && this.kept?.distance(this.view)) ?? 1;
  }

  invalidate() {
    this.pending ||= requestAnimationFrame(() => {
      this.pending = 0;
      if (this.held === undefined) this.draw();
    });
  }

  draw() {
    const { gl, canvas, mesh, view } = this;
    if (!gl || gl.isContextLost() || !mesh || !view || !canvas.clientWidth) return;
    this.isFirst = this.isSlow && !canvas.dataset.drawn;
    if (this.isFirst) this.drawCoarsely();
    const isCoarse = this.settling !== undefined;
    const ratio = Math.min(devicePixelRatio, MAX_RATIO) * (isCoarse ? COARSE_RATIO : 1);
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const aspect = width / height;
    const isBelow = this.isBelow(mesh, view);
    const kept = this.kept?.view && this.isBelow(mesh, this.kept.view) === isBelow ? this.kept : null; // else it shows the floor's other side
    const isSame = kept?.distance(view) === 0;
    if ((kept || isBelow) && !isSame) this.prepareLight(mesh); // not while the mesh is measured or the canvas is drawn: it binds other framebuffers
    if (kept && !isSame) {
      kept.measure(mesh, (toClip, from) => this.drawMesh(toClip, mesh, from, null, null));
    }
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    kept?.drawBehind(mesh, view, aspect, this.above, this.keptFloor(mesh));
    canvas.dataset.drawn = String(mesh.triangles);
    if (isSame) return;
    if (isBelow) {
      this.drawBackdrop(view, aspect, mesh, this.prepareLight(mesh), this.backdropProgram());
      return;
    }
    const reach = !kept && this.hasFloor ? FLOOR_REACH : 1;
    this.drawMesh(clipMatrix(view, aspect, mesh.low, mesh.high, reach), mesh, view, kept, { width, height });
    if (this.isRefining) this.refining ||= requestAnimationFrame(() => this.refine());
  }

  /** Whether the shadows become better while the camera rests. */
  get isRefining() {
    if (this.isSlow && this.isReplacedSoon) return false;
    return Boolean(this.shadows?.isPossible && this.mesh && !this.kept && this.view && !this.isBelow(this.mesh, this.view) && this.held === undefined && this.settling === undefined && !this.shadows.isDone);
  }

  /** Computes further shadows, and shows them once they are done. */
  refine() {
    this.refining = 0;
    const { shadows } = this;
    if (!shadows || !this.isRefining || this.gl?.isContextLost()) return;
    if (shadows.work()) this.draw();
    if (this.isRefining) this.refining ||= requestAnimationFrame(() => this.refine());
  }

  /**
   * Draws opaque surfaces, what is behind them, glass, and blended surfaces from the farthest on.
   *
   * @param {Float32Array<ArrayBuffer>} toClip
   * @param {MeshPacket} mesh
   * @param {View} view
   * @param {KeptPicture | null} kept
   * @param {{width: number, height: number} | null} onPage size of the canvas; null: the mesh is drawn into a texture, without its surroundings
   */
  drawMesh(toClip, mesh, view, kept, onPage) {
    const { gl, programs, mirrors } = this;
    if (!gl || !programs) return;
    const light = this.prepareLight(mesh);
    const parts = this.partsOf(mesh).filter((each) => mirrors?.drawing?.isChosen(each) ?? true);
    if (onPage && !kept && !this.isFirst) this.drawMirrored(parts, mesh, view, light);
    const { drawing = null, features: reflecting = [] } = mirrors ?? {};
    const isQuick = this.isFirst && mesh.triangles > SHADOWED_AT_ONCE;
    const shadows = onPage && !kept && !isQuick && this.shadows?.isPossible ? this.shadows : null;
    const eye = drawing ? [...drawing.from, 1] : view.projection === "orthographic" ? [...cameraAxes(view)[2], 0] : [...fromMiddle(view.eye, mesh.low, mesh.high), 1];
    const isDefaultCurve = this.look.curve === curveIndex(DEFAULT_CURVE);
    /** @type {import("./mesh-program.js").Feature[]} */
    const looks = isDefaultCurve ? [] : ["CURVES"];
    if (light.lamps.length) looks.push("LAMPS");
    if (light.rectangles.some(Boolean)) looks.push("RECTANGLES");
    /**
     * Chooses the program that draws some parts. Returns false if the driver refuses it.
     *
     * @param {{material: MeshMaterial}[]} of
     * @param {number} pass
     * @param {{isDense?: boolean, isMirror?: boolean}} [how]
     */
    const use = (of, pass, { isDense = false, isMirror = false } = {}) => {
      const features = [...looks, ...featuresOf(of)];
      if (kept) features.push("KEPT");
      if (shadows) features.push("SHADOWS");
      if (isMirror) features.push(...reflecting);
      const linked = isDense ? programs.with(DENSE_VERTEX, DENSE_FRAGMENT, features) : programs.with(VERTEX, FRAGMENT, features);
      if (!linked) return false;
      const { program, at } = linked;
      this.at = at;
      gl.useProgram(program);
      gl.uniform1i(at("pass"), pass);
      kept?.bind(program, mesh, view);
      for (const [name, unit] of Object.entries(UNITS)) gl.uniform1i(at(name), unit);
      bind(gl, UNITS.around, light.texture);
      gl.uniformMatrix4fv(at("toClip"), false, toClip);
      gl.uniform3fv(at("extent"), mesh.high.map((value, i) => value - (mesh.low[i] ?? 0)));
      gl.uniform4fv(at("eye"), eye);
      gl.uniform1f(at("gain"), this.look.gain);
      gl.uniform1i(at("curve"), this.look.curve);
      gl.uniform1i(at("isForMirrors"), drawing ? 1 : 0);
      gl.uniform3fv(at("irradiance"), light.irradiance);
      this.setLamps(light, mesh);
      if (onPage) shadows?.bind(at, onPage);
      gl.uniform1i(at("mirroredDepth"), MIRROR_UNITS.depth[this.kept ? "kept" : "alone"]);
      gl.uniform1i(at("mirroredBalls"), MIRROR_UNITS.balls[this.kept ? "kept" : "alone"]);
      gl.uniform1i(at("hasBehind"), 0);
      gl.uniform1i(at("isBlack"), light.isBlack ? 1 : 0);
      return true;
    };
    if (onPage) shadows?.follow(toClip, eye, onPage);
    if (onPage) gl.viewport(0, 0, onPage.width, onPage.height);
    const draw = (/** @type {DrawnPart} */ each) => {
      if (drawing?.isSeen(each) ?? true) this.drawPart(each);
    };
    const glass = parts.filter(({ material }) => material.transmission > 0 && !drawing);
    const blended = parts.filter(({ material }) => material.transmission === 0 && material.alpha_mode === "blend");
    const away = (/** @type {Vec3} */ middle) => middle.reduce((sum, value, i) => sum + (eye[3] ? ((eye[i] ?? 0) - value) ** 2 : -(eye[i] ?? 0) * value), 0);
    const farthestFirst = (/** @type {typeof parts} */ of) => of.toSorted((a, b) => away(b.middle) - away(a.middle));
    bind(gl, UNITS.behind, this.textures.at(-1) ?? null);
    const opaque = parts.filter(({ material }) => material.transmission === 0 || drawing);
    for (const dense of [true, false]) {
      const chosen = opaque.filter(({ isDense, material }) => dense === (isDense && isDefaultCurve && isPlain(material)));
      // All that is no mirror has the first frame's program, which is also faster.
      for (const shows of [false, true]) {
        const of = chosen.filter(({ showsScene }) => shows === (showsScene && reflecting.length > 0));
        if (of.length && use(drawing ? of : [...chosen, ...(dense ? [] : blended)], PASS.opaque, { isDense: dense, isMirror: shows })) of.forEach(draw);
      }
    }
    if (onPage && shadows && this.hasFloor) this.drawFloor(shadows, toClip, eye, onPage, light, looks);
    const hasBehind = onPage !== null && glass.length > 0;
    if (hasBehind) this.copyBehind(onPage, glass.some(({ material }) => material.roughness > BLURRED));
    if (onPage && !kept) {
      this.drawBackdrop(view, onPage.width / onPage.height, mesh, light, this.backdropProgram());
    }
    if (glass.length && use(glass, PASS.glass, { isMirror: true })) {
      gl.uniform1i(this.at("hasBehind"), hasBehind ? 1 : 0);
      if (hasBehind) bind(gl, UNITS.behind, this.behind);
      farthestFirst(glass).forEach(draw);
    }
    if (blended.length && use([...opaque, ...blended], PASS.blend, { isMirror: blended.some(({ showsScene }) => showsScene) })) {
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
      gl.enable(gl.CULL_FACE);
      for (const each of farthestFirst(blended))
        for (const face of [gl.FRONT, gl.BACK]) {
          gl.cullFace(face); // the far side first
          draw(each);
        }
      gl.disable(gl.CULL_FACE);
      gl.depthMask(true);
      gl.disable(gl.BLEND);
    }
    gl.activeTexture(gl.TEXTURE0);
  }

  /** Returns the parts, with their materials, and whether they show the scene. @param {MeshPacket} mesh @returns {DrawnPart[]} */
  partsOf(mesh) {
    return mesh.parts.map((part, i) => {
      const place = /** @type {import("./mesh-parts.js").Place} */ (this.places[i]);
      const material = /** @type {MeshMaterial} */ (mesh.materials[part.material]);
      return { part, ...place, material, showsScene: isMirror(material) };
    });
  }

  /** Draws the scene for its mirrors. @param {DrawnPart[]} parts @param {MeshPacket} mesh @param {View} view @param {NonNullable<MeshCanvas["light"]>} light */
  drawMirrored(parts, mesh, view, light) {
    const radius = Math.hypot(...mesh.high.map((value, i) => value - (mesh.low[i] ?? 0))) / 2 || 1;
    const lamps = new Set(light.rectangles.flatMap((each) => each?.part ?? []));
    this.mirrors?.draw(parts, { radius, triangles: mesh.triangles, lamps, look: [light, this.look.gain] }, (toClip) => this.drawMesh(toClip, mesh, view, null, null));
  }

  /** @param {DrawnPart} drawn */
  drawPart({ part, material, showsScene, isBall, size }) {
    const { gl, at, textures } = this;
    if (!gl) return;
    bind(gl, UNITS.roughMetal, textures.at(material.metallic_roughness_texture) ?? null); // -1 is the last
    bind(gl, UNITS.glow, textures.at(material.emission_texture) ?? null);
    gl.uniform1f(at("metallic"), material.metallic);
    gl.uniform1f(at("roughness"), material.roughness);
    gl.uniform3fv(at("f0"), material.f0);
    gl.uniform3fv(at("emission"), material.emission);
    gl.uniform1f(at("transmission"), material.transmission);
    gl.uniform1f(at("ior"), material.ior);
    gl.uniform1i(at("thin"), material.thin ? 1 : 0);
    gl.uniform1f(at("coat"), material.coat);
    gl.uniform1f(at("coatRoughness"), material.coat_roughness);
    gl.uniform1i(at("unlit"), material.unlit ? 1 : 0);
    gl.uniform1i(at("isBall"), isBall && !material.thin ? 1 : 0);
    gl.uniform1f(at("depth"), material.thin ? 0 : size);
    gl.uniform1i(at("showsScene"), showsScene && this.mirrors?.bind(part, at, this.kept !== null) ? 1 : 0);
    gl.uniform1i(at("isWhole"), material.texture < 0 && !this.kept ? 1 : 0);
    this.drawShape(part, material, at);
  }

  /** Draws the triangles of a part where they are not transparent. @param {MeshPart} part @param {MeshMaterial} material @param {(name: string) => WebGLUniformLocation | null} at finds the program's uniforms */
  drawShape({ first, corners }, material, at) {
    const { gl, textures } = this;
    if (!gl) return;
    bind(gl, UNITS.image, textures.at(material.texture) ?? null);
    gl.uniform1i(at("alphaMode"), ALPHA_MODES[material.alpha_mode]);
    gl.uniform1f(at("cutoff"), material.cutoff);
    gl.drawElements(gl.TRIANGLES, corners, gl.UNSIGNED_INT, 4 * first);
  }

  /** Computes the light around the mesh, where it has changed. @param {MeshPacket} mesh */
  prepareLight(mesh) {
    const gl = /** @type {WebGL2RenderingContext} */ (this.gl);
    const { hasFloor } = this;
    if (this.light?.hasFloor === hasFloor && this.light.above === this.above) return this.light;
    const { environment, lamps: chosen } = chosenLight(mesh, this.chosen) ?? { environment: null, lamps: mesh.lamps };
    const isBlack = environment === null;
    const { lamps, around } = lampsOf(chosen, isBlack, mesh);
    const tables = tablesOf(mesh, JSON.stringify(this.chosen), () => environment, { up: this.above, hasFloor, suns: sunsOn(this.above, lamps), around, isAlone: isBlack });
    this.forgetLight();
    gl.activeTexture(gl.TEXTURE0 + UNITS.around);
    this.light = { texture: aroundTexture(gl, tables), irradiance: tables.irradiance, lamps, rectangles: rectanglesOf(mesh, lamps), hasFloor, above: this.above, isBlack, floor: tables.floor, below: null };
    if (this.shadows?.isPossible) this.shadows.begin({ mesh, tables, lamps: lamps.slice(0, MOST_LAMPS), above: hasFloor ? this.above : null, isAlone: isBlack, drawPart: (part, material, at) => this.drawShape(part, material, at) });
    return this.light;
  }

  /** @param {Pick<NonNullable<MeshCanvas["light"]>, "lamps" | "rectangles">} light @param {MeshPacket} mesh */
  setLamps({ lamps, rectangles }, { low, high }) {
    const { gl, at } = this;
    if (!gl) return;
    gl.uniform1i(at("lampCount"), lamps.length);
    if (!lamps.length) return;
    gl.uniform4fv(at("lamps"), lamps.flatMap((lamp) => (lamp.far ? [...unit(lamp.at), 0] : [...fromMiddle(lamp.at, low, high), 1])));
    gl.uniform3fv(at("lampColors"), lamps.flatMap(({ color }) => color));
    gl.uniform3fv(at("lampAxes"), lamps.flatMap(({ axis }) => axis));
    gl.uniform2fv(at("lampCosines"), lamps.flatMap(({ cosines }) => cosines));
    gl.uniform3fv(at("lampHalves"), rectangles.flatMap((each) => each?.halves.flat() ?? [0, 0, 0, 0, 0, 0]));
    gl.uniform3fv(at("lampRadiances"), rectangles.flatMap((each) => each?.radiance ?? [0, 0, 0]));
  }

  /** Copies what is drawn before glass into a texture. @param {{width: number, height: number}} size @param {boolean} isBlurred */
  copyBehind({ width, height }, isBlurred) {
    const { gl } = this;
    if (!gl) return;
    this.behind ??= gl.createTexture();
    bind(gl, UNITS.behind, this.behind);
    gl.copyTexImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 0, 0, width, height, 0);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, isBlurred ? gl.LINEAR_MIPMAP_LINEAR : gl.LINEAR);
    if (isBlurred) gl.generateMipmap(gl.TEXTURE_2D);
  }

  /**
   * @param {MeshShadows} shadows
   * @param {Float32Array<ArrayBuffer>} toClip
   * @param {number[]} eye
   * @param {{width: number, height: number}} size of the canvas
   * @param {NonNullable<MeshCanvas["light"]>} light
   * @param {import("./mesh-program.js").Feature[]} features
   */
  drawFloor(shadows, toClip, eye, size, light, features) {
    const { gl, programs, mesh } = this;
    const linked = programs?.with(FLOOR_VERTEX, FLOOR_FRAGMENT, ["SHADOWS", ...features]);
    if (!gl || !linked || !mesh) return;
    const { at } = (this.at = linked.at, linked);
    gl.useProgram(linked.program);
    shadows.placeFloor(at);
    shadows.bind(at, size);
    gl.uniform1i(at("around"), UNITS.around);
    gl.uniformMatrix4fv(at("toClip"), false, toClip);
    gl.uniform4fv(at("eye"), eye);
    gl.uniform1f(at("gain"), this.look.gain);
    gl.uniform1i(at("curve"), this.look.curve);
    this.setLamps(light, mesh);
    const isBlended = light.lamps.length > 0; // else it hides what is behind it, which need not be shaded
    if (isBlended) {
      gl.enable(gl.BLEND);
      gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
      gl.depthMask(false);
    } else {
      gl.enable(gl.POLYGON_OFFSET_FILL);
      gl.polygonOffset(1, 2); // below what lies on it
    }
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.disable(gl.POLYGON_OFFSET_FILL);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  /** Returns the program that draws what is behind the mesh. */
  backdropProgram() {
    return this.programs?.with(BACKDROP_VERTEX, BACKDROP_FRAGMENT, this.look.curve === curveIndex(DEFAULT_CURVE) ? [] : ["CURVES"]) ?? null;
  }

  /** @param {View} view @param {number} aspect @param {MeshPacket} mesh @param {NonNullable<MeshCanvas["light"]>} light @param {import("./mesh-program.js").Linked | null} linked */
  drawBackdrop(view, aspect, mesh, light, linked) {
    const { gl } = this;
    if (!gl || !linked) return;
    const { program, at } = linked;
    const { isBlack, floor } = light;
    const [right, up, back] = cameraAxes(view);
    const isFlat = view.projection === "orthographic";
    const half = isFlat ? 0 : Math.tan((Math.min(view.fov, 170) * Math.PI) / 360);
    const [shiftX, shiftY] = [2 * half * (view.shift_x ?? 0), 2 * half * (view.shift_y ?? 0)];
    gl.useProgram(program);
    const isBelow = this.isBelow(mesh, view);
    bind(gl, UNITS.around, isBelow ? this.aroundBelow(light) : light.texture);
    gl.uniform1i(at("around"), UNITS.around);
    gl.uniform1f(at("gain"), isBlack ? 0 : this.look.gain);
    gl.uniform1i(at("curve"), this.look.curve);
    gl.uniform3fv(at("forward"), back.map((value, i) => shiftX * (right[i] ?? 0) + shiftY * (up[i] ?? 0) - value));
    gl.uniform3fv(at("across"), right.map((value) => half * aspect * value));
    gl.uniform3fv(at("upward"), up.map((value) => half * value));
    const { above } = floorMap({ mesh, above: this.above });
    const reach = floorReach(mesh);
    const eye = this.onFloor(mesh, view);
    const isOver = floor !== null && !isFlat && eye.every((value) => Math.abs(value) < reach);
    gl.uniform1i(at("isBelow"), isBelow ? 1 : 0);
    gl.uniform3fv(at("lowerSide"), floor?.below.radiance ?? [0, 0, 0]);
    gl.uniform3fv(at("eye"), eye);
    gl.uniform3fv(at("above"), above);
    gl.uniform1f(at("reach"), isOver ? reach : 0);
    gl.uniform3fv(at("beyond"), floor?.beyond ?? [0, 0, 0]);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE_MINUS_DST_ALPHA, gl.ONE); // under the floor
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.disable(gl.BLEND);
  }

  /** Returns a camera's place, relative to the middle of the floor. @param {MeshPacket} mesh @param {View} view */
  onFloor(mesh, view) {
    const { above, height } = floorMap({ mesh, above: this.above });
    return fromMiddle(view.eye, mesh.low, mesh.high).map((value, i) => value - height * (above[i] ?? 0));
  }

  /** Returns what a kept picture shows as the floor where it does not show it. @param {MeshPacket} mesh */
  keptFloor(mesh) {
    if (!this.hasFloor || !this.light?.floor) return null;
    const { lamps, floor } = this.light;
    const suns = sunsOn(this.above, lamps);
    const light = /** @type {Vec3} */ (floor.radiance.map((value, i) => this.look.gain * (value + floor.albedo * (suns[i] ?? 0))));
    return { reach: floorReach(mesh), light: lamps.every(({ far }) => far) ? light : null, curve: this.look.curve };
  }

  /** Returns whether the floor hides the whole mesh from a camera. @param {MeshPacket} mesh @param {View} view */
  isBelow(mesh, view) {
    const { above } = floorMap({ mesh, above: this.above });
    return this.hasFloor && view.projection !== "orthographic" && this.onFloor(mesh, view).reduce((sum, value, i) => sum + value * (above[i] ?? 0), 0) < 0;
  }

  /** Returns the light around the scene without the floor. @param {NonNullable<MeshCanvas["light"]>} light */
  aroundBelow(light) {
    const { gl } = this;
    if (!gl || light.below || !light.floor) return light.below;
    gl.activeTexture(gl.TEXTURE0 + UNITS.around);
    return (light.below = aroundTexture(gl, { levels: [light.floor.below.around] }));
  }

  dispose() {
    cancelAnimationFrame(this.pending);
    cancelAnimationFrame(this.refining);
    clearTimeout(this.held);
    clearTimeout(this.settling);
    this.resizing.disconnect();
    this.release();
    this.gl?.getExtension("WEBGL_lose_context")?.loseContext();
  }
}

/** Returns whether a processor draws in place of a graphics card. `failIfMajorPerformanceCaveat` does not tell it in every browser. @param {WebGL2RenderingContext} gl */
function isSoftware(gl) {
  const known = gl.getExtension("WEBGL_debug_renderer_info");
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(gl.getParameter(known?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER));
}

/** @param {WebGL2RenderingContext} gl @param {number} unit @param {WebGLTexture | null} texture */
function bind(gl, unit, texture) {
  gl.activeTexture(gl.TEXTURE0 + unit);
  gl.bindTexture(gl.TEXTURE_2D, texture);
}

/** Returns what the program of some parts must draw. @param {{material: MeshMaterial}[]} parts */
function featuresOf(parts) {
  /** @type {import("./mesh-program.js").Feature[]} */
  const features = [];
  const has = (/** @type {(material: MeshMaterial) => boolean} */ test) => parts.some(({ material }) => test(material));
  if (has(({ transmission }) => transmission > 0)) features.push("GLASS");
  if (has(({ coat }) => coat > 0)) features.push("COAT");
  if (has((material) => Math.max(material.metallic_roughness_texture, material.emission_texture) >= 0)) features.push("MAPS");
  return features;
}

/** Returns whether a material is shaded by its vertices alone. @param {MeshMaterial} material */
const isPlain = (material) => !material.unlit && material.transmission === 0 && material.coat === 0 && material.alpha_mode !== "blend" && Math.max(material.metallic_roughness_texture, material.emission_texture) < 0;

/** @param {number[]} vector @returns {Vec3} */
const unit = (vector) => /** @type {Vec3} */ (vector.map((value) => value / (Math.hypot(...vector) || 1)));
