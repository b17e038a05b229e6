/** The shadow of a preview mesh on the studio's floor: dark below the scene's bounds, and fading around them. */

import { programOf } from "./mesh-program.js";

/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */

const VERTEX = `#version 300 es
uniform mat4 toClip;
uniform vec3 across;
uniform vec3 along;
uniform vec3 middle;
out vec2 at;
void main() {
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 3.0 - 1.5;
  gl_Position = toClip * vec4(middle + at.x * across + at.y * along, 1.0);
}`;
const FRAGMENT = `#version 300 es
precision highp float;
in vec2 at;
out vec4 pixel;
void main() {
  float away = length(at);
  pixel = vec4(0.0, 0.0, 0.0, 0.3 * (1.0 - smoothstep(0.3, 1.45, away)));
}`;

/** @param {WebGL2RenderingContext} gl */
export const shadowProgram = (gl) => programOf(gl, VERTEX, FRAGMENT);

/**
 * @param {WebGL2RenderingContext} gl
 * @param {WebGLProgram} program of shadowProgram
 * @param {Float32Array<ArrayBuffer>} toClip
 * @param {MeshPacket} mesh
 * @param {import("../base/types.js").Vec3} above up in the scene
 */
export function drawShadow(gl, program, toClip, { low, high }, above) {
  const sizes = above.map(Math.abs);
  const axis = sizes.indexOf(Math.max(...sizes));
  const half = high.map((value, i) => (value - (low[i] ?? 0)) / 2);
  /** @param {number} i @param {number} value */
  const onAxis = (i, value) => [0, 1, 2].map((each) => (each === i ? value : 0));
  const [across, along] = [(axis + 1) % 3, (axis + 2) % 3];
  gl.useProgram(program);
  gl.uniformMatrix4fv(gl.getUniformLocation(program, "toClip"), false, toClip);
  gl.uniform3fv(gl.getUniformLocation(program, "middle"), onAxis(axis, -(half[axis] ?? 0) * Math.sign(above[axis] ?? 1)));
  gl.uniform3fv(gl.getUniformLocation(program, "across"), onAxis(across, half[across] ?? 0));
  gl.uniform3fv(gl.getUniformLocation(program, "along"), onAxis(along, half[along] ?? 0));
  gl.enable(gl.BLEND);
  gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  gl.depthMask(false);
  gl.drawArrays(gl.TRIANGLE_STRIP, 0, 4);
  gl.depthMask(true);
  gl.disable(gl.BLEND);
}
