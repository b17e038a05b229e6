/**
 * The WebGL2 canvas: one picture, or two beside each other at a wipe. What is drawn is decided by `layers`, `wipe`, `look`
 * and `viewport`; `invalidate` draws once at the next frame.
 */

import { FilmLayer } from "./film-layer.js";
import { FRAGMENT, VERTEX, curveIndex, partIndex } from "./film-shader.js";
import { t } from "../base/words.js";

/** @typedef {import("./viewport.js").Viewport} Viewport */

/** @typedef {{exposure: number, curve: string, part?: string}} Look */

const UNIFORMS = /** @type {const} */ (["film", "canvasSize", "origin", "scale", "gain", "curve", "raw", "part"]);

/** The browser cannot show a film: the message says why, for a person. */
export class CannotShow extends Error {}

export class FilmCanvas {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLCanvasElement} over is kept in the same place
   * @param {Viewport} viewport
   */
  constructor(canvas, over, viewport) {
    this.canvas = canvas;
    this.over = over;
    this.viewport = viewport;
    /** @type {Look} */
    this.look = { exposure: 0, curve: "neutral" };
    /** How much of the canvas' width, from the left, is the first layer's; the rest is the second's. */
    this.wipe = 1;
    /** Told after every draw, to move what lies over the picture. */
    this.afterDraw = () => {};
    this.pending = 0;

    const gl = canvas.getContext("webgl2", { antialias: false, depth: false, powerPreference: "high-performance" });
    if (!gl)
      throw new CannotShow(
        t("This browser has no WebGL 2, which the live picture needs. The downloads below still work."),
      );
    this.gl = gl;
    this.maxSize = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    /** Left and right of the wipe. */
    this.layers = /** @type {const} */ ([
      new FilmLayer(gl, () => this.invalidate()),
      new FilmLayer(gl, () => this.invalidate()),
    ]);
    /** An image over both, a map of what differs. */
    this.cover = new FilmLayer(gl, () => this.invalidate());
    /** Each layer in a half of the canvas, at the same place of the picture. */
    this.sideBySide = false;
    this.build();
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.build();
      for (const layer of [...this.layers, this.cover]) layer.restore();
    });
  }

  build() {
    const gl = this.gl;
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
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      throw new CannotShow(
        t("This browser's graphics driver refused the page's shader: {program}", { program: gl.getProgramInfoLog(program) ?? "" }),
      );
    }
    gl.useProgram(program);
    this.uniforms = Object.fromEntries(UNIFORMS.map((name) => [name, gl.getUniformLocation(program, name)]));
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  }

  /**
   * The size of the picture, which is the first layer's; the second is drawn as wide.
   *
   * @param {number} width
   * @param {number} height
   */
  setPicture(width, height) {
    if (width > this.maxSize || height > this.maxSize) {
      throw new CannotShow(
        t("The picture is {width}×{height}; this browser shows up to {maxSize}×{maxSize}. The downloads still have all of it.", { width, height, maxSize: this.maxSize }),
      );
    }
    this.viewport.setPicture(width, height);
  }

  /** Lays the canvas onto the screen's own pixels, so that a pixel of it is one of them: layout gives fractions of both. */
  resize() {
    const ratio = devicePixelRatio;
    const box = /** @type {Element} */ (this.canvas.parentElement).getBoundingClientRect();
    const left = Math.ceil(box.left * ratio - 1e-3);
    const top = Math.ceil(box.top * ratio - 1e-3);
    const width = Math.max(1, Math.floor(box.right * ratio + 1e-3) - left);
    const height = Math.max(1, Math.floor(box.bottom * ratio + 1e-3) - top);
    for (const canvas of [this.canvas, this.over]) {
      const style = {
        left: left / ratio - box.left,
        top: top / ratio - box.top,
        width: width / ratio,
        height: height / ratio,
      };
      for (const [name, value] of Object.entries(style)) canvas.style.setProperty(name, `${value}px`);
    }
    if (width !== this.canvas.width || height !== this.canvas.height) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.viewport.resizeCanvas(width, height);
      this.draw(); // at once: a resized canvas is blank until it is drawn
    }
  }

  invalidate() {
    this.pending ||= requestAnimationFrame(() => this.draw());
  }

  draw() {
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    const { gl, canvas, wipe } = this;
    if (gl.isContextLost() || !this.uniforms) return;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.disable(gl.SCISSOR_TEST);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.enable(gl.SCISSOR_TEST);
    const split = Math.round(wipe * canvas.width);
    const [first, second] = this.layers;
    if (this.cover.image) {
      this.drawLayer(this.cover, 0, canvas.width);
    } else if (this.sideBySide) {
      const [left, right] = this.panes();
      if (left) this.drawLayer(first, left.left, left.width, left.shift);
      if (right) this.drawLayer(second, right.left, right.width, right.shift);
    } else {
      this.drawLayer(first, 0, split);
      this.drawLayer(second, split, canvas.width - split);
    }
    this.afterDraw();
  }

  /** The parts of the canvas that each show the picture: from where, how wide, and how far from where the viewport has it. */
  panes() {
    const { width } = this.canvas;
    const half = Math.floor(width / 2);
    if (!this.sideBySide || this.cover.image) return [{ left: 0, width, shift: 0 }];
    const quarter = Math.round(width / 4);
    return [
      { left: 0, width: half, shift: -quarter },
      { left: half, width: width - half, shift: quarter },
    ];
  }

  /**
   * A layer's pixels as they are shown, RGBA from the top; null where there is nothing.
   *
   * @param {FilmLayer} layer
   * @returns {Uint8Array | null}
   */
  pixelsOf(layer) {
    const { gl, uniforms, look } = this;
    if (!layer.texture || !layer.size || gl.isContextLost()) return null;
    const { width, height } = layer.size;
    const target = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, target);
    gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA8, width, height);
    const frame = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, frame);
    gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, target, 0);
    gl.viewport(0, 0, width, height);
    gl.disable(gl.SCISSOR_TEST);
    gl.bindTexture(gl.TEXTURE_2D, layer.texture);
    gl.uniform1i(uniforms?.film ?? null, 0);
    gl.uniform2f(uniforms?.canvasSize ?? null, width, height);
    gl.uniform2f(uniforms?.origin ?? null, 0, 0);
    gl.uniform1f(uniforms?.scale ?? null, 1);
    gl.uniform1f(uniforms?.gain ?? null, 2 ** look.exposure);
    gl.uniform1i(uniforms?.curve ?? null, curveIndex(look.curve));
    gl.uniform1i(uniforms?.part ?? null, 0);
    gl.uniform1i(uniforms?.raw ?? null, layer.image ? 1 : 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
    const below = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, below);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(frame);
    gl.deleteTexture(target);
    const found = new Uint8Array(below.length);
    for (let y = 0; y < height; y++) found.set(below.subarray(4 * width * y, 4 * width * (y + 1)), 4 * width * (height - 1 - y));
    this.invalidate();
    return found;
  }

  /**
   * @param {FilmLayer} layer
   * @param {number} left of the strip of the canvas that it fills
   * @param {number} width
   * @param {number} [shift] to the right, of the picture
   */
  drawLayer(layer, left, width, shift = 0) {
    const { gl, canvas, viewport, look, uniforms } = this;
    if (!layer.texture || !layer.size || width <= 0) return;
    if ((layer.film?.isBlank || layer.film?.isPartial) && !layer.image) return; // what lies under the canvas is seen
    gl.scissor(left, 0, width, canvas.height);
    gl.bindTexture(gl.TEXTURE_2D, layer.texture);
    gl.uniform1i(uniforms?.film ?? null, 0);
    gl.uniform2f(uniforms?.canvasSize ?? null, canvas.width, canvas.height);
    gl.uniform2f(uniforms?.origin ?? null, viewport.x + shift, viewport.y);
    gl.uniform1f(uniforms?.scale ?? null, (viewport.scale * viewport.picture.width) / layer.size.width);
    gl.uniform1f(uniforms?.gain ?? null, 2 ** look.exposure);
    gl.uniform1i(uniforms?.curve ?? null, curveIndex(look.curve));
    gl.uniform1i(uniforms?.part ?? null, partIndex(look.part ?? ""));
    gl.uniform1i(uniforms?.raw ?? null, layer.image ? 1 : 0);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  dispose() {
    for (const layer of [...this.layers, this.cover]) layer.clear();
    cancelAnimationFrame(this.pending);
    this.gl.getExtension("WEBGL_lose_context")?.loseContext(); // browsers allow only some 16 contexts
  }
}
