/**
 * The last picture without noise of a live view, drawn for another camera while its own picture is being rendered: projected from the
 * camera that it was rendered for onto the preview mesh, onto the floor, and onto what is far away.
 */

import { TONEMAP_GLSL } from "../film/tonemap.js";
import { cameraAxes, clipMatrix } from "./mesh-camera.js";
import { programOf } from "./mesh-program.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */

/**
 * How much of the kept picture is seen at a point, and its colour there. softness: 0 for the picture's own camera, in which every point
 * is seen as it was; else what lies at the picture's edge, or was seen at a grazing angle, fades.
 */
export const KEPT_GLSL = `
uniform sampler2D kept;
uniform highp sampler2D keptDepth;
uniform sampler2D keptShade;
uniform mat4 keptClip;
uniform vec4 keptEye; // its place, with 1, or of an orthographic camera the direction to it, with 0
uniform vec4 seenEye;
uniform float softness;
const float SLACK = 0.012; // of the distance, within which two points are one: the mesh is simplified
const float FLAT_SLACK = 0.03; // of the scene's depth in an orthographic picture, about as much
vec3 wayTo(vec4 camera, vec3 place) {
  return normalize(camera.xyz - camera.w * place);
}
// Part of the points around uv, so far away in widths of the picture, in which the mesh is not nearer than z.
float open(float z, vec2 uv, float margin) {
  vec2 size = vec2(textureSize(keptDepth, 0));
  vec2 wide = max(margin * size.x, 0.7) / size;
  float count = 0.0;
  for (int i = 0; i < 9; i++) {
    vec2 corner = uv + wide * (vec2(i % 3, i / 3) - 1.0);
    if (z <= 2.0 * textureLod(keptDepth, corner, 0.0).r - 1.0) count += 1.0 / 9.0;
  }
  return count;
}
// How bright the picture is by the mesh's shading, around what the picture shows where the point is or, if it is hidden, before it.
vec3 keptLight(vec3 place) {
  const float AROUND = 7.0; // level of detail
  vec4 at = keptClip * vec4(place, 1.0);
  vec2 uv = at.w > 0.0 ? clamp(0.5 + 0.5 * at.xy / at.w, 0.05, 0.95) : vec2(0.5);
  return clamp((textureLod(kept, uv, AROUND).rgb + 0.02) / (textureLod(keptShade, uv, AROUND).rgb + 0.02), 0.1, 2.0);
}
vec4 keptAt(vec3 place, vec3 n, float margin) {
  vec4 at = keptClip * vec4(place, 1.0);
  if (at.w <= 0.0) return vec4(0.0);
  vec2 uv = 0.5 + 0.5 * at.xy / at.w;
  vec2 edge = smoothstep(vec2(0.0), vec2(0.001 + 0.05 * softness), min(uv, 1.0 - uv));
  float slope = length(vec3(keptClip[0].z, keptClip[1].z, keptClip[2].z));
  float z = at.z / at.w;
  float slack = keptEye.w > 0.5 ? SLACK * abs(z - slope) : FLAT_SLACK;
  float near = open(min(z - slack, 1.0) - 1e-6, uv, margin);
  if (margin > 0.0) near = smoothstep(0.85, 1.0, near);
  float facing = abs(dot(n, wayTo(keptEye, place)));
  float sharp = smoothstep(0.05, 0.35, facing);
  // Where the picture would be stretched more than about twice, the mesh shows more. The floor, which has a margin, shows nothing of its own.
  if (margin == 0.0) sharp *= smoothstep(0.3, 0.6, facing / max(abs(dot(n, wayTo(seenEye, place))), 0.05));
  float weight = edge.x * edge.y * near * mix(1.0, sharp, softness);
  return vec4(textureLod(kept, uv, 0.0).rgb, weight);
}`;

const VERTEX = `#version 300 es
out vec2 at;
void main() {
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(at, 0.9999999, 1.0);
}`;
const MARGIN_GLSL = "const float MARGIN = 0.008; // width of the rim around the mesh that has its colour, too";
/** The picture without the mesh, multiplied by its alpha. */
const BEHIND = `#version 300 es
precision highp float;
${KEPT_GLSL}
${MARGIN_GLSL}
in vec2 at;
out vec4 pixel;
void main() {
  vec2 uv = 0.5 + 0.5 * at;
  float alone = smoothstep(0.85, 1.0, open(1.0, uv, MARGIN));
  pixel = vec4(textureLod(kept, uv, 0.0).rgb, 1.0) * alone;
}`;
const BEHIND_VERTEX = `#version 300 es
uniform vec4 floorLight; // exposed radiance of the floor where no shadow falls on it; alpha 0: it is not known
uniform int curve;
out vec2 at;
flat out vec4 floorShown;
${TONEMAP_GLSL}
void main() {
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  floorShown = vec4(displayed(floorLight.rgb, curve), floorLight.a);
  gl_Position = vec4(at, 0.9999999, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
${KEPT_GLSL}
flat in vec4 floorShown;
uniform vec2 shaded; // distances from the middle between which the floor's shadow ends
uniform bool isSame;
uniform vec3 eye;
uniform vec3 forward;
uniform vec3 across;
uniform vec3 upward;
uniform vec3 above;
uniform float floorHeight;
uniform float reach; // half the floor's side length; 0: there is none
uniform sampler2D keptBehind;
in vec2 at;
out vec4 pixel;
${MARGIN_GLSL}
const float BLUR = 3.0; // level of detail of what stands in for what the picture does not show
// What the picture shows of the floor, and where the mesh hides it, the colours beside the mesh: its shadow goes on behind it.
vec4 filled(vec3 place, vec4 lying) {
  vec4 at = keptClip * vec4(place, 1.0);
  vec2 uv = at.w > 0.0 ? 0.5 + 0.5 * at.xy / at.w : vec2(-1.0);
  vec2 edge = smoothstep(vec2(0.0), vec2(0.001 + 0.05 * softness), min(uv, 1.0 - uv));
  vec4 sum = vec4(0.0);
  for (int level = 0; level < 10 && sum.a < 0.99; level++) { // finer levels count first
    vec4 found = textureLod(keptBehind, uv, float(level));
    sum += (1.0 - sum.a) * smoothstep(0.0, 0.6, found.a) * vec4(found.rgb / max(found.a, 1e-3), 1.0);
  }
  float known = edge.x * edge.y * step(0.05, sum.a) * (1.0 - floorShown.a * smoothstep(shaded.x, shaded.y, length(place)));
  return vec4(mix(sum.rgb / max(sum.a, 1e-3), lying.rgb, lying.a), max(lying.a, known));
}
vec3 distant(vec3 way) {
  vec4 place = keptClip * vec4(way, 0.0);
  vec2 uv = place.w > 1e-6 ? 0.5 + 0.5 * place.xy / place.w : vec2(0.5, 0.95);
  vec2 inside = clamp(uv, 0.01, 0.99);
  vec3 beside = mix(textureLod(kept, vec2(0.01, inside.y), BLUR).rgb, textureLod(kept, vec2(0.99, inside.y), BLUR).rgb, inside.x);
  float left = open(1.0, vec2(0.01, inside.y), MARGIN), right = open(1.0, vec2(0.99, inside.y), MARGIN);
  if (left * right < 1.0) beside = left > right ? textureLod(kept, vec2(0.01, inside.y), BLUR).rgb : textureLod(kept, vec2(0.99, inside.y), BLUR).rgb;
  float free = smoothstep(0.85, 1.0, open(1.0, inside, MARGIN));
  return mix(beside, textureLod(kept, inside, BLUR * smoothstep(0.0, 0.1, length(uv - inside))).rgb, free);
}
void main() {
  if (isSame) {
    pixel = vec4(texture(kept, 0.5 + 0.5 * at).rgb, 1.0);
    return;
  }
  vec3 aside = at.x * across + at.y * upward;
  vec3 from = seenEye.w > 0.5 ? eye : eye + aside;
  vec3 way = normalize(seenEye.w > 0.5 ? forward + aside : forward);
  vec3 color = distant(way);
  float fall = dot(way, above);
  float away = reach > 0.0 && abs(fall) > 1e-5 ? (floorHeight - dot(from, above)) / fall : -1.0;
  if (away > 0.0) {
    vec4 lying = keptAt(from + away * way, above, MARGIN);
    if (lying.a < 1.0) lying = filled(from + away * way, lying);
    vec3 exits = (reach - sign(way) * (from - dot(from, above) * above)) / max(abs(way - fall * above), 1e-6) + 1e9 * abs(above); // distance to the floor's sides
    float left = dot(from, above) - floorHeight + fall * min(exits.x, min(exits.y, exits.z)); // height above the floor's edge
    float onFloor = clamp(0.5 - left / max(fwidth(left), 1e-9), 0.0, 1.0);
    color = mix(color, mix(floorShown.rgb, lying.rgb, lying.a), onFloor * max(floorShown.a, lying.a));
  }
  pixel = vec4(color, 1.0);
}`;

/** Turn of the camera, as an angle plus its way by its distance, from which a kept picture shows little of what the camera sees. */
const FAR_TURN = 0.9;

/** Distances from the middle, in radii of the scene, between which hidden floor changes from the colour of the picture beside it to that without shadows. */
const SHADED = [2, 4];

export class KeptPicture {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    this.program = programOf(gl, BEHIND_VERTEX, FRAGMENT);
    /** @type {WebGLTexture | null} */
    this.color = null;
    /** @type {WebGLTexture | null} */
    this.depth = null;
    /** The mesh as the picture's camera sees it, without the picture. @type {WebGLTexture | null} */
    this.shade = null;
    /** The picture without the mesh, as BEHIND writes it. @type {WebGLTexture | null} */
    this.behind = null;
    this.behindProgram = programOf(gl, VERTEX, BEHIND);
    this.frame = gl.createFramebuffer();
    this.behindFrame = gl.createFramebuffer();
    /** The camera of the picture; null: there is no picture. @type {View | null} */
    this.view = null;
    this.width = this.height = 1;
    this.hasDepth = false;
  }

  /** @param {TexImageSource & {width: number, height: number}} picture as displayed @param {View} view its camera */
  set(picture, view) {
    const { gl } = this;
    this.view = view;
    this.hasDepth = false;
    this.color ??= gl.createTexture();
    this.depth ??= gl.createTexture();
    this.shade ??= gl.createTexture();
    this.behind ??= gl.createTexture();
    [this.width, this.height] = [picture.width, picture.height];
    gl.activeTexture(gl.TEXTURE1);
    gl.bindTexture(gl.TEXTURE_2D, this.color);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, true);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, gl.RGBA, gl.UNSIGNED_BYTE, picture);
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.generateMipmap(gl.TEXTURE_2D);
    smooth(gl);
    gl.activeTexture(gl.TEXTURE0);
  }

  /** Removes the picture and frees its textures; `set` gives another one. */
  clear() {
    for (const texture of [this.color, this.depth, this.shade, this.behind]) this.gl.deleteTexture(texture);
    this.color = this.depth = this.shade = this.behind = null;
    this.view = null;
    this.hasDepth = false;
  }

  /** How far a camera is from the picture's: 0 the same, 1 so far that the picture is of little use. @param {View} view */
  distance(view) {
    const old = this.view;
    if (!old) return 1;
    if (JSON.stringify(old) === JSON.stringify(view)) return 0;
    if (view.projection !== old.projection) return 1;
    const [a, b] = [cameraAxes(old)[2], cameraAxes(view)[2]];
    const angle = Math.acos(Math.min(1, Math.max(-1, a[0] * b[0] + a[1] * b[1] + a[2] * b[2])));
    const way = Math.hypot(...view.eye.map((value, i) => value - (old.eye[i] ?? 0)));
    const away = Math.hypot(...old.eye.map((value, i) => value - (old.target[i] ?? 0))) || 1;
    const zoom = isFlat(view) ? Math.abs(Math.log((view.height ?? 2) / (old.height ?? 2))) : 0;
    return Math.min(1, Math.max(1e-3, (angle + way / away + zoom) / 2 / FAR_TURN));
  }

  /**
   * Renders what the picture's camera sees of the mesh, once for each picture: distances and shading.
   *
   * @param {MeshPacket} mesh
   * @param {(toClip: Float32Array<ArrayBuffer>, view: View) => void} drawMesh
   */
  measure(mesh, drawMesh) {
    const { gl, view, width, height } = this;
    if (this.hasDepth || !view) return;
    gl.activeTexture(gl.TEXTURE2);
    gl.bindTexture(gl.TEXTURE_2D, this.depth);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.DEPTH_COMPONENT24, width, height, 0, gl.DEPTH_COMPONENT, gl.UNSIGNED_INT, null);
    for (const name of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, name, gl.NEAREST);
    for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
    gl.bindTexture(gl.TEXTURE_2D, null); // it is not read while it is written
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, this.shade);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    smooth(gl);
    gl.bindTexture(gl.TEXTURE_2D, null);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.shade, 0);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, this.depth, 0);
    gl.viewport(0, 0, width, height);
    gl.clear(gl.DEPTH_BUFFER_BIT);
    this.drawBehind(mesh, view, width / height, [0, 1, 0], null); // where there is no mesh the picture is as bright as itself
    drawMesh(clipMatrix(view, width / height, mesh.low, mesh.high), view);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.activeTexture(gl.TEXTURE3);
    gl.bindTexture(gl.TEXTURE_2D, this.shade);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.activeTexture(gl.TEXTURE0);
    this.hasDepth = true;
    this.drawWithoutMesh(mesh, view);
  }

  /** @param {MeshPacket} mesh @param {View} view the picture's camera */
  drawWithoutMesh(mesh, view) {
    const { gl, behindProgram, width, height } = this;
    if (!behindProgram) return;
    gl.activeTexture(gl.TEXTURE4);
    gl.bindTexture(gl.TEXTURE_2D, this.behind);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA8, width, height, 0, gl.RGBA, gl.UNSIGNED_BYTE, null);
    smooth(gl);
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.behindFrame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.behind, 0);
    gl.useProgram(behindProgram);
    this.bind(behindProgram, mesh, view);
    gl.activeTexture(gl.TEXTURE4);
    gl.bindTexture(gl.TEXTURE_2D, null); // it is not read while it is written
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.bindTexture(gl.TEXTURE_2D, this.behind);
    gl.generateMipmap(gl.TEXTURE_2D);
    gl.activeTexture(gl.TEXTURE0);
  }

  /**
   * Sets what KEPT_GLSL reads.
   *
   * @param {WebGLProgram} program in use
   * @param {MeshPacket} mesh
   * @param {View} seen the camera that the picture is drawn for
   */
  bind(program, { low, high }, seen) {
    const { gl, view, width, height } = this;
    if (!view) return;
    const at = (/** @type {string} */ name) => gl.getUniformLocation(program, name);
    for (const [unit, texture] of [
      [1, this.color],
      [2, this.hasDepth ? this.depth : null],
      [3, this.hasDepth ? this.shade : null],
      [4, this.hasDepth ? this.behind : null],
    ]) {
      gl.activeTexture(gl.TEXTURE0 + Number(unit));
      gl.bindTexture(gl.TEXTURE_2D, /** @type {WebGLTexture | null} */ (texture));
    }
    gl.activeTexture(gl.TEXTURE0);
    gl.uniform1i(at("kept"), 1);
    gl.uniform1i(at("keptDepth"), 2);
    gl.uniform1i(at("keptShade"), 3);
    gl.uniform1i(at("keptBehind"), 4);
    gl.uniformMatrix4fv(at("keptClip"), false, clipMatrix(view, width / height, low, high));
    const camera = (/** @type {View} */ of) => (isFlat(of) ? [...cameraAxes(of)[2], 0] : [...fromMiddle(of.eye, low, high), 1]);
    gl.uniform4fv(at("keptEye"), camera(view));
    gl.uniform4fv(at("seenEye"), camera(seen));
    gl.uniform1f(at("softness"), Math.min(1, 4 * this.distance(seen)));
  }

  /**
   * Fills the canvas with what is behind the mesh; for the picture's own camera, with the whole picture.
   *
   * @param {MeshPacket} mesh
   * @param {View} seen the camera
   * @param {number} aspect
   * @param {Vec3} above upward in the scene
   * @param {{reach: number, light: Vec3 | null, curve: number} | null} floor reach: half its side length. light: its exposed radiance where no shadow falls on it, if that is known
   */
  drawBehind(mesh, seen, aspect, above, floor) {
    const { gl, program } = this;
    if (!program || !this.view) return;
    const { low, high } = mesh;
    const at = (/** @type {string} */ name) => gl.getUniformLocation(program, name);
    gl.useProgram(program);
    this.bind(program, mesh, seen);
    const half = isFlat(seen) ? (seen.height ?? 2) / 2 : Math.tan((seen.fov * Math.PI) / 360);
    const [right, up, back] = cameraAxes(seen);
    const [shiftX, shiftY] = [half * 2 * (seen.shift_x ?? 0), half * 2 * (seen.shift_y ?? 0)];
    const ground = above.map((value, i) => value * ((value > 0 ? (low[i] ?? 0) : (high[i] ?? 0)) - ((low[i] ?? 0) + (high[i] ?? 0)) / 2));
    gl.uniform1i(at("isSame"), this.distance(seen) === 0 ? 1 : 0);
    const shift = [0, 1, 2].map((i) => shiftX * (right[i] ?? 0) + shiftY * (up[i] ?? 0));
    const moved = (/** @type {number[]} */ vector, /** @type {boolean} */ isMoved) => vector.map((value, i) => value + (isMoved ? (shift[i] ?? 0) : 0));
    gl.uniform3fv(at("eye"), moved(fromMiddle(seen.eye, low, high), isFlat(seen)));
    gl.uniform3fv(at("forward"), moved(back.map((value) => -value), !isFlat(seen)));
    gl.uniform3fv(at("across"), right.map((value) => value * half * aspect));
    gl.uniform3fv(at("upward"), up.map((value) => value * half));
    gl.uniform3fv(at("above"), above);
    gl.uniform1f(at("floorHeight"), ground.reduce((sum, value) => sum + value, 0));
    gl.uniform1f(at("reach"), floor?.reach ?? 0);
    gl.uniform4fv(at("floorLight"), floor?.light ? [...floor.light, 1] : [0, 0, 0, 0]);
    gl.uniform1i(at("curve"), floor?.curve ?? 0);
    gl.uniform2fv(at("shaded"), SHADED.map((value) => (value * Math.hypot(...high.map((top, i) => top - (low[i] ?? 0)))) / 2));
    gl.disable(gl.DEPTH_TEST);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    gl.enable(gl.DEPTH_TEST);
  }
}

/** @param {View} view */
const isFlat = ({ projection }) => projection === "orthographic";

/** Filters the texture that is bound, with mipmaps. @param {WebGL2RenderingContext} gl */
function smooth(gl) {
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.LINEAR_MIPMAP_LINEAR);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.LINEAR);
  for (const name of [gl.TEXTURE_WRAP_S, gl.TEXTURE_WRAP_T]) gl.texParameteri(gl.TEXTURE_2D, name, gl.CLAMP_TO_EDGE);
}

/** @param {Vec3} point @param {Vec3} low @param {Vec3} high @returns {number[]} relative to the middle of the bounds */
export const fromMiddle = (point, low, high) => point.map((value, i) => value - ((low[i] ?? 0) + (high[i] ?? 0)) / 2);
