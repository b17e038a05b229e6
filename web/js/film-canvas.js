/**
 * The WebGL2 canvas: a film's RGB9E5 texture, written tile by tile, and the draw call that shows it. What is drawn is
 * decided by `look` and `viewport`; `invalidate` draws once at the next frame.
 */

import { FRAGMENT, VERTEX, curveIndex } from "./film-shader.js";

/** @typedef {import("./film.js").Film} Film */
/** @typedef {import("./tile-packet.js").TilePacket} TilePacket */
/** @typedef {import("./viewport.js").Viewport} Viewport */

/** @typedef {{exposure: number, curve: string}} Look */

const UNIFORMS = /** @type {const} */ (["film", "canvasSize", "origin", "scale", "gain", "curve", "raw"]);

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
    /** @type {Film | null} */
    this.film = null;
    /** A finished display image (an AOV) that is shown in the film's place. @type {ImageBitmap | null} */
    this.overlay = null;
    /** Told after every draw, to move what lies over the picture. */
    this.afterDraw = () => {};
    this.pending = 0;

    const gl = canvas.getContext("webgl2", { antialias: false, depth: false, powerPreference: "high-performance" });
    if (!gl)
      throw new CannotShow(
        "This browser has no WebGL 2, which the live picture needs. The downloads below still work.",
      );
    this.gl = gl;
    this.maxSize = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    this.build();
    canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    canvas.addEventListener("webglcontextrestored", () => {
      this.build();
      this.uploadAll();
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
        `This browser's graphics driver refused the page's shader: ${gl.getProgramInfoLog(program)}`,
      );
    }
    gl.useProgram(program);
    this.uniforms = Object.fromEntries(UNIFORMS.map((name) => [name, gl.getUniformLocation(program, name)]));
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    this.filmTexture = null;
    this.overlayTexture = null;
  }

  /** @param {Film} film */
  setFilm(film) {
    if (film.width > this.maxSize || film.height > this.maxSize) {
      throw new CannotShow(
        `The picture is ${film.width}×${film.height}; this browser shows up to ${this.maxSize}×${this.maxSize}. The downloads still have all of it.`,
      );
    }
    this.film = film;
    this.viewport.setPicture(film.width, film.height);
    this.uploadAll();
  }

  /** @param {ImageBitmap | null} image */
  setOverlay(image) {
    this.overlay?.close();
    this.overlay = image;
    this.uploadOverlay();
    this.invalidate();
  }

  /** @param {TilePacket} tile already put into the film */
  putTile({ x, y, w, h, words }) {
    const { gl } = this;
    if (!this.film || x + w > this.film.width || y + h > this.film.height) return;
    gl.bindTexture(gl.TEXTURE_2D, this.filmTexture ?? null);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, w, h, gl.RGB, gl.UNSIGNED_INT_5_9_9_9_REV, words);
    this.invalidate();
  }

  uploadAll() {
    const { gl, film } = this;
    if (film) {
      gl.deleteTexture(this.filmTexture ?? null);
      this.filmTexture = this.newTexture(gl.RGB9_E5, film.width, film.height);
      gl.texSubImage2D(
        gl.TEXTURE_2D,
        0,
        0,
        0,
        film.width,
        film.height,
        gl.RGB,
        gl.UNSIGNED_INT_5_9_9_9_REV,
        film.words,
      );
    }
    this.uploadOverlay();
    this.invalidate();
  }

  uploadOverlay() {
    const { gl, overlay } = this;
    gl.deleteTexture(this.overlayTexture ?? null);
    this.overlayTexture = null;
    if (!overlay) return;
    this.overlayTexture = this.newTexture(gl.RGBA8, overlay.width, overlay.height);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, gl.RGBA, gl.UNSIGNED_BYTE, overlay);
  }

  /**
   * @param {GLenum} format
   * @param {number} width
   * @param {number} height
   */
  newTexture(format, width, height) {
    const { gl } = this;
    const texture = gl.createTexture();
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
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
    const { gl, canvas, viewport, look, uniforms } = this;
    if (gl.isContextLost() || !uniforms) return;
    gl.viewport(0, 0, canvas.width, canvas.height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT);
    const texture = this.overlayTexture ?? this.filmTexture;
    if (texture) {
      gl.bindTexture(gl.TEXTURE_2D, texture);
      gl.uniform1i(uniforms.film ?? null, 0);
      gl.uniform2f(uniforms.canvasSize ?? null, canvas.width, canvas.height);
      gl.uniform2f(uniforms.origin ?? null, viewport.x, viewport.y);
      gl.uniform1f(uniforms.scale ?? null, viewport.scale);
      gl.uniform1f(uniforms.gain ?? null, 2 ** look.exposure);
      gl.uniform1i(uniforms.curve ?? null, curveIndex(look.curve));
      gl.uniform1i(uniforms.raw ?? null, this.overlayTexture ? 1 : 0);
      gl.drawArrays(gl.TRIANGLES, 0, 3);
    }
    this.afterDraw();
  }

  dispose() {
    cancelAnimationFrame(this.pending);
    this.overlay?.close();
    this.gl.getExtension("WEBGL_lose_context")?.loseContext(); // browsers allow only some 16 contexts
  }
}
