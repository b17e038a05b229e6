/** Draws a scene's preview mesh with WebGL: shaded triangles, seen by the camera of the live view. */

import { KEPT_GLSL, KeptPicture, fromMiddle } from "./kept-picture.js";
import { cameraAxes, clipMatrix } from "./mesh-camera.js";
import { programOf } from "./mesh-program.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */

const VERTEX = `#version 300 es
uniform mat4 toClip;
uniform vec3 extent;
in vec3 share;
in vec3 normal;
in vec4 color;
in vec2 uv;
out vec3 place;
out vec3 facing;
out vec4 shown;
out vec2 texel;
void main() {
  texel = uv;
  place = (share - 0.5) * extent;
  facing = normal;
  shown = color;
  gl_Position = toClip * vec4(place, 1.0);
}`;

/** Lamps that the mesh is shaded by. */
const MOST_LAMPS = 4;
/** Irradiance of all lamps together at the middle of the scene, were none behind its surfaces. */
const LAMPS_SUM = 1.5;

/**
 * In the studio, its light (renderer/scene/studio.py): walls and two lamps, without shadows. Else the scene's lamps, without shadows or, where
 * they are not known, light from the camera's upper left, and less from all around. Both sides of a surface are lit.
 */
const FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 light;
uniform vec3 above;
uniform vec3 eye;
uniform bool inStudio;
uniform sampler2D image;
uniform float cutoff;
uniform bool hasKept;
uniform int lampCount;
uniform vec4 lamps[${MOST_LAMPS}]; // places, with 1, or directions, with 0
uniform vec3 lampColors[${MOST_LAMPS}]; // their irradiance at the middle
${KEPT_GLSL}
in vec2 texel;
in vec3 place;
in vec3 facing;
in vec4 shown;
out vec4 pixel;
const float OPEN = 0.9; // how much of the light no other surface keeps away, about
const vec3 KEY = vec3(-0.560, 0.646, 0.517);
const vec3 RIM = vec3(0.685, 0.343, -0.642);
const float AROUND = 0.12; // light that other surfaces reflect, about
vec3 lampLight(vec3 place, vec3 n) {
  vec3 sum = vec3(AROUND);
  for (int i = 0; i < lampCount; i++) {
    vec3 way = lamps[i].xyz - lamps[i].w * place;
    float far = dot(lamps[i].xyz, lamps[i].xyz);
    float near = lamps[i].w > 0.5 ? min(far / max(dot(way, way), 1e-12), 4.0) : 1.0;
    sum += lampColors[i] * near * max(dot(n, normalize(way)), 0.0);
  }
  return sum;
}
void main() {
  vec4 base = texture(image, texel);
  if (base.a < cutoff) discard;
  vec3 flatly = normalize(cross(dFdx(place), dFdy(place)));
  if (dot(flatly, eye - place) < 0.0) flatly = -flatly;
  vec3 n = dot(facing, facing) > 0.01 ? normalize(facing) : flatly;
  if (dot(n, flatly) < 0.0) n = -n;
  vec3 color = shown.rgb * base.rgb;
  if (shown.a > 0.5 && inStudio) {
    float walls = mix(0.33, 0.62, 0.5 + 0.5 * dot(n, above));
    float shade = OPEN * (walls + 0.65 * max(dot(n, KEY), 0.0) + 0.24 * max(dot(n, RIM), 0.0));
    color = pow(pow(color, vec3(2.2)) * shade, vec3(1.0 / 2.2));
  } else if (shown.a > 0.5 && lampCount > 0) {
    color = pow(min(pow(color, vec3(2.2)) * lampLight(place, n), 1.0), vec3(1.0 / 2.2));
  } else if (shown.a > 0.5) color *= 0.5 + 0.5 * abs(dot(n, light));
  if (hasKept) {
    vec4 known = keptAt(place, flatly, 0.0);
    color = mix(color * keptLight(place), known.rgb, known.a);
  }
  pixel = vec4(color, 1.0);
}`;

/** The shadow on the studio's floor: dark below the scene's bounds, and fading around them. */
const SHADOW_VERTEX = `#version 300 es
uniform mat4 toClip;
uniform vec3 across;
uniform vec3 along;
uniform vec3 middle;
out vec2 at;
void main() {
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 3.0 - 1.5;
  gl_Position = toClip * vec4(middle + at.x * across + at.y * along, 1.0);
}`;
const SHADOW_FRAGMENT = `#version 300 es
precision highp float;
in vec2 at;
out vec4 pixel;
void main() {
  float away = length(at);
  pixel = vec4(0.0, 0.0, 0.0, 0.42 * (1.0 - smoothstep(0.3, 1.45, away)));
}`;

const MAX_RATIO = 2;

/** @param {WebGL2RenderingContext} gl */
function whiteTexture(gl) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array([255, 255, 255, 255]));
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  return texture;
}

export class MeshCanvas {
  /** @param {HTMLCanvasElement} canvas as large as its box */
  constructor(canvas) {
    this.canvas = canvas;
    /** Whether the scene stands on the studio's floor, if it is in the studio. */
    this.hasFloor = false;
    /** @type {WebGLProgram | null} */
    this.shadow = null;
    /** Upward in the scene. @type {import("../base/types.js").Vec3} */
    this.above = [0, 1, 0];
    /** @type {MeshPacket | null} */
    this.mesh = null;
    /** @type {View | null} */
    this.view = null;
    /** A picture without noise, which is projected onto the mesh. @type {KeptPicture | null} */
    this.kept = null;
    /** What has projected a picture, for the next one: its programs take long to compile. @type {KeptPicture | null} */
    this.projector = null;
    this.pending = 0;
    this.gl = canvas.getContext("webgl2", { alpha: true, antialias: true, depth: true });
    /** @type {WebGLProgram | null} */
    this.program = null;
    /** By number; the last is white. @type {WebGLTexture[]} */
    this.textures = [];
    /** Vertices and indices of the mesh. @type {WebGLBuffer[]} */
    this.buffers = [];
    this.resizing = new ResizeObserver(() => this.invalidate());
    this.resizing.observe(canvas);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.projector = this.program = null; // its programs were lost too
      if (this.mesh) this.setMesh(this.mesh);
    });
  }

  /** Compiles the programs, before the first mesh if there is time. */
  compile() {
    const { gl } = this;
    if (!gl || this.program || gl.isContextLost()) return;
    this.program = programOf(gl, VERTEX, FRAGMENT);
    this.shadow = programOf(gl, SHADOW_VERTEX, SHADOW_FRAGMENT);
  }

  /** @param {MeshPacket} mesh */
  setMesh(mesh) {
    const { gl } = this;
    this.mesh = mesh;
    this.release();
    this.compile();
    const { program } = this;
    if (!gl || gl.isContextLost() || !program) return; // the picture comes without a preview
    const { background } = mesh;
    this.canvas.style.background = background ? `rgb(${background.join(" ")})` : "";
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    for (const each of this.buffers.splice(0)) gl.deleteBuffer(each); // of an earlier mesh
    for (const each of this.textures) gl.deleteTexture(each);
    /** @param {number} target @param {any} data */
    const fill = (target, data) => {
      const buffer = gl.createBuffer();
      this.buffers.push(buffer);
      gl.bindBuffer(target, buffer);
      gl.bufferData(target, data, gl.STATIC_DRAW);
    };
    /** @param {string} name @param {any} data @param {number} size @param {number} type */
    const attribute = (name, data, size, type) => {
      const at = gl.getAttribLocation(program, name);
      fill(gl.ARRAY_BUFFER, data);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, type, true, type === gl.UNSIGNED_SHORT || type === gl.FLOAT ? 8 : 4, 0);
    };
    attribute("share", mesh.positions, 3, gl.UNSIGNED_SHORT);
    attribute("normal", mesh.normals, 3, gl.BYTE);
    attribute("color", mesh.colors, 4, gl.UNSIGNED_BYTE);
    if (mesh.uvs) attribute("uv", mesh.uvs, 2, gl.FLOAT);
    else gl.disableVertexAttribArray(gl.getAttribLocation(program, "uv"));
    fill(gl.ELEMENT_ARRAY_BUFFER, mesh.indices);
    this.textures = [...(mesh.textures ?? []), null].map(() => whiteTexture(gl));
    mesh.textures?.forEach((arriving, number) => void arriving.then((image) => image && this.mesh === mesh && this.setTexture(number, image)));
    this.invalidate();
  }

  /** @param {number} number @param {ImageBitmap} image */
  setTexture(number, image) {
    const { gl } = this;
    if (!gl || gl.isContextLost()) return;
    gl.bindTexture(gl.TEXTURE_2D, this.textures[number] ?? null);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, image);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
    this.canvas.dataset.textures = String(Number(this.canvas.dataset.textures ?? 0) + 1);
    this.invalidate();
  }

  /** @param {import("../base/types.js").Scene} scene */
  setScene({ cameras, has_floor: hasFloor, floor }) {
    this.above = cameras.at(-1)?.view.up ?? this.above; // the automatic camera's
    this.hasFloor = hasFloor || Boolean(floor);
    this.invalidate();
  }

  /** @param {View} view */
  setView(view) {
    this.view = view;
    this.invalidate();
  }

  /**
   * Projects a picture onto the mesh from now on.
   *
   * @param {HTMLCanvasElement} picture
   * @param {View} view its camera
   */
  keep(picture, view) {
    if (!this.gl || !this.program || this.gl.isContextLost()) return;
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
      this.draw();
    });
  }

  draw() {
    const { gl, canvas, mesh, view, program } = this;
    if (!gl || !mesh || !view || !program || !canvas.clientWidth) return;
    const ratio = Math.min(devicePixelRatio, MAX_RATIO);
    const [width, height] = [Math.round(canvas.clientWidth * ratio), Math.round(canvas.clientHeight * ratio)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    const aspect = width / height;
    const { kept } = this;
    const isSame = kept?.distance(view) === 0;
    if (kept && !isSame) kept.measure(mesh, (toClip, from) => this.drawMesh(toClip, mesh, from, null));
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    kept?.drawBehind(mesh, view, aspect, this.above, this.hasFloor);
    canvas.dataset.drawn = String(mesh.triangles);
    if (isSame) return;
    const toClip = clipMatrix(view, aspect, mesh.low, mesh.high);
    this.drawMesh(toClip, mesh, view, kept);
    if (this.hasFloor && !mesh.background && !kept) this.drawShadow(toClip, mesh);
  }

  /**
   * @param {Float32Array<ArrayBuffer>} toClip
   * @param {MeshPacket} mesh
   * @param {View} view
   * @param {KeptPicture | null} kept
   */
  drawMesh(toClip, mesh, view, kept) {
    const { gl, program } = this;
    if (!gl || !program) return;
    gl.useProgram(program);
    gl.uniform1i(gl.getUniformLocation(program, "hasKept"), kept ? 1 : 0);
    gl.uniform1i(gl.getUniformLocation(program, "kept"), 1); // units of their own, also while they are empty
    gl.uniform1i(gl.getUniformLocation(program, "keptDepth"), 2);
    gl.uniform1i(gl.getUniformLocation(program, "keptShade"), 3);
    kept?.bind(program, mesh, view);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "toClip"), false, toClip);
    gl.uniform3fv(gl.getUniformLocation(program, "above"), this.above);
    gl.uniform3fv(gl.getUniformLocation(program, "eye"), fromMiddle(view.eye, mesh.low, mesh.high));
    gl.uniform1i(gl.getUniformLocation(program, "inStudio"), mesh.background ? 0 : 1);
    gl.uniform3fv(gl.getUniformLocation(program, "extent"), mesh.high.map((value, i) => value - (mesh.low[i] ?? 0)));
    const [right, above, back] = cameraAxes(view);
    const light = [0, 1, 2].map((i) => -0.4 * (right[i] ?? 0) + 0.5 * (above[i] ?? 0) + 0.77 * (back[i] ?? 0));
    gl.uniform3fv(gl.getUniformLocation(program, "light"), light);
    const lamps = (mesh.background && mesh.lamps?.toSorted((a, b) => Math.max(...b.color) - Math.max(...a.color)).slice(0, MOST_LAMPS)) || [];
    gl.uniform1i(gl.getUniformLocation(program, "lampCount"), lamps.length);
    if (lamps.length) {
      const total = lamps.reduce((sum, { color }) => sum + Math.max(...color), 0) || 1;
      const places = lamps.flatMap(({ at, isFar }) => (isFar ? [...at, 0] : [...fromMiddle(at, mesh.low, mesh.high), 1]));
      gl.uniform4fv(gl.getUniformLocation(program, "lamps"), places);
      gl.uniform3fv(gl.getUniformLocation(program, "lampColors"), lamps.flatMap(({ color }) => color.map((value) => (LAMPS_SUM * value) / total)));
    }
    for (const { first, count, texture, cutoff } of mesh.parts ?? [{ first: 0, count: 3 * mesh.triangles, texture: -1, cutoff: 0 }]) {
      gl.bindTexture(gl.TEXTURE_2D, this.textures.at(texture) ?? null); // -1 is the last
      gl.uniform1f(gl.getUniformLocation(program, "cutoff"), cutoff);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * first);
    }
  }

  /** @param {Float32Array<ArrayBuffer>} toClip @param {MeshPacket} mesh */
  drawShadow(toClip, { low, high }) {
    const { gl, shadow, above } = this;
    if (!gl || !shadow) return;
    const sizes = above.map(Math.abs);
    const axis = sizes.indexOf(Math.max(...sizes));
    const half = high.map((value, i) => (value - (low[i] ?? 0)) / 2);
    /** @param {number} i @param {number} value */
    const onAxis = (i, value) => [0, 1, 2].map((each) => (each === i ? value : 0));
    const [across, along] = [(axis + 1) % 3, (axis + 2) % 3];
    gl.useProgram(shadow);
    gl.uniformMatrix4fv(gl.getUniformLocation(shadow, "toClip"), false, toClip);
    gl.uniform3fv(gl.getUniformLocation(shadow, "middle"), onAxis(axis, -(half[axis] ?? 0) * Math.sign(above[axis] ?? 1)));
    gl.uniform3fv(gl.getUniformLocation(shadow, "across"), onAxis(across, half[across] ?? 0));
    gl.uniform3fv(gl.getUniformLocation(shadow, "along"), onAxis(along, half[along] ?? 0));
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
    gl.depthMask(false);
    gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
    gl.depthMask(true);
    gl.disable(gl.BLEND);
  }

  dispose() {
    cancelAnimationFrame(this.pending);
    this.resizing.disconnect();
    this.release();
    this.gl?.getExtension("WEBGL_lose_context")?.loseContext();
  }
}
