/** Draws a scene's preview mesh with WebGL: shaded triangles, seen by the camera of the live view. */

import { cameraAxes, clipMatrix } from "./mesh-camera.js";

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

/** Light from the camera's upper left, and less from all around; both sides of a surface are lit. */
const FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 light;
uniform sampler2D image;
uniform float cutoff;
in vec2 texel;
in vec3 place;
in vec3 facing;
in vec4 shown;
out vec4 pixel;
void main() {
  vec4 base = texture(image, texel);
  if (base.a < cutoff) discard;
  vec3 flatly = cross(dFdx(place), dFdy(place));
  vec3 n = normalize(dot(facing, facing) > 0.01 ? facing : flatly);
  float shade = mix(1.0, 0.5 + 0.5 * abs(dot(n, light)), step(0.5, shown.a));
  pixel = vec4(shown.rgb * base.rgb * shade, 1.0);
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
    /** @type {MeshPacket | null} */
    this.mesh = null;
    /** @type {View | null} */
    this.view = null;
    this.pending = 0;
    this.gl = canvas.getContext("webgl2", { alpha: true, antialias: true, depth: true });
    /** @type {WebGLProgram | null} */
    this.program = null;
    /** By number; the last is white. @type {WebGLTexture[]} */
    this.textures = [];
    this.resizing = new ResizeObserver(() => this.invalidate());
    this.resizing.observe(canvas);
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => this.mesh && this.setMesh(this.mesh));
  }

  /** @param {MeshPacket} mesh */
  setMesh(mesh) {
    const { gl } = this;
    this.mesh = mesh;
    if (!gl || gl.isContextLost()) return;
    const program = gl.createProgram();
    for (const [type, source] of /** @type {const} */ ([
      [gl.VERTEX_SHADER, VERTEX],
      [gl.FRAGMENT_SHADER, FRAGMENT],
    ])) {
      const shader = /** @type {WebGLShader} */ (gl.createShader(type));
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) return; // the picture comes without a preview
    this.program = program;
    gl.useProgram(program);
    gl.enable(gl.DEPTH_TEST);
    /** @param {string} name @param {ArrayBufferView<ArrayBuffer>} data @param {number} size @param {number} type */
    const attribute = (name, data, size, type) => {
      const at = gl.getAttribLocation(program, name);
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
      gl.bufferData(gl.ARRAY_BUFFER, data, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(at);
      gl.vertexAttribPointer(at, size, type, true, type === gl.UNSIGNED_SHORT || type === gl.FLOAT ? 8 : 4, 0);
    };
    attribute("share", /** @type {any} */ (mesh.positions), 3, gl.UNSIGNED_SHORT);
    attribute("normal", /** @type {any} */ (mesh.normals), 3, gl.BYTE);
    attribute("color", /** @type {any} */ (mesh.colors), 4, gl.UNSIGNED_BYTE);
    if (mesh.uvs) attribute("uv", /** @type {any} */ (mesh.uvs), 2, gl.FLOAT);
    else gl.disableVertexAttribArray(gl.getAttribLocation(program, "uv"));
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, /** @type {any} */ (mesh.indices), gl.STATIC_DRAW);
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

  /** @param {View} view */
  setView(view) {
    this.view = view;
    this.invalidate();
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
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "toClip"), false, clipMatrix(view, width / height, mesh.low, mesh.high));
    gl.uniform3fv(gl.getUniformLocation(program, "extent"), mesh.high.map((value, i) => value - (mesh.low[i] ?? 0)));
    const [right, above, back] = cameraAxes(view);
    const light = [0, 1, 2].map((i) => -0.4 * (right[i] ?? 0) + 0.5 * (above[i] ?? 0) + 0.77 * (back[i] ?? 0));
    gl.uniform3fv(gl.getUniformLocation(program, "light"), light);
    for (const { first, count, texture, cutoff } of mesh.parts ?? [{ first: 0, count: 3 * mesh.triangles, texture: -1, cutoff: 0 }]) {
      gl.bindTexture(gl.TEXTURE_2D, this.textures.at(texture) ?? null); // -1 is the last
      gl.uniform1f(gl.getUniformLocation(program, "cutoff"), cutoff);
      gl.drawElements(gl.TRIANGLES, count, gl.UNSIGNED_INT, 4 * first);
    }
    canvas.dataset.drawn = String(mesh.triangles);
  }

  dispose() {
    cancelAnimationFrame(this.pending);
    this.resizing.disconnect();
    this.gl?.getExtension("WEBGL_lose_context")?.loseContext();
  }
}
