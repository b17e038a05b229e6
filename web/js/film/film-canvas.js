/**
 * The WebGL2 canvas: one picture, or two side by side at a wipe. Drawn from `layers`, `wipe`, `look` and `viewport`;
 * `invalidate` redraws at the next animation frame.
 */

import { FilmLayer } from "./film-layer.js";
import { FRAGMENT, VERTEX, VIEW_CURVE, curveIndex, partIndex } from "./film-shader.js";
import { isView } from "./curves.js";
import { viewTable } from "./view-tables.js";
import { t } from "../base/words.js";

/** @typedef {import("./viewport.js").Viewport} Viewport */

/** @typedef {{exposure: number, curve: string, part?: string, high?: boolean}} Look high: with the display's high dynamic range */

/** Side of the squares behind a transparent picture, in CSS pixels. */
const SQUARE = 8;

/** Minimum pause, in milliseconds, between the end of a drawing and the next one for new tiles. */
const TILES_MS = 150;
/** Interval, in milliseconds, at which the end of a drawing is looked for. */
const FENCE_MS = 10;

const UNIFORMS = /** @type {const} */ (["film", "canvasSize", "origin", "scale", "gain", "curve", "viewTable", "coding", "part", "alpha", "hasAlpha", "square", "high"]);

/** Error: the browser cannot show a film; the message is the reason. */
export class CannotShow extends Error {}

export class FilmCanvas {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {HTMLCanvasElement} over resized and placed like the canvas
   * @param {Viewport} viewport
   */
  constructor(canvas, over, viewport) {
    this.canvas = canvas;
    this.over = over;
    this.viewport = viewport;
    /** @type {Look} */
    this.look = { exposure: 0, curve: "neutral" };
    /** Name of the view whose table is in the texture of unit 1; "" for none. */
    this.viewName = "";
    /** Position of the wipe as a fraction of the canvas' width; the first layer is on its left. */
    this.wipe = 1;
    /** Called after every draw, to update overlays. */
    this.afterDraw = () => {};
    this.pending = 0;
    /** Runs while a drawing is executed and during the pause after it. @type {ReturnType<typeof setTimeout> | undefined} */
    this.resting = undefined;
    /** Whether tiles have arrived since the last drawing. */
    this.isOutdated = false;
    this.redraw = () => this.invalidate(); // one function, which waits for a view's table once

    const gl = canvas.getContext("webgl2", { antialias: false, depth: false, powerPreference: "high-performance" });
    if (!gl)
      throw new CannotShow(
        t("This browser has no WebGL 2, which the live picture needs. The downloads below still work."),
      );
    this.gl = gl;
    this.maxSize = gl.getParameter(gl.MAX_TEXTURE_SIZE);
    /** Layers left and right of the wipe. */
    this.layers = /** @type {const} */ ([
      new FilmLayer(gl, () => this.invalidate(), () => this.invalidateForTile(0)),
      new FilmLayer(gl, () => this.invalidate(), () => this.invalidateForTile(1)),
    ]);
    /** An image over both layers, such as a difference map. */
    this.cover = new FilmLayer(gl, () => this.invalidate());
    /** Shows pictures of high dynamic range over this canvas; null: they have standard range. @type {import("./high-range.js").HighRange | null} */
    this.high = null;
    /** Whether each layer is shown in its own half of the canvas, with the same part of the picture. */
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
    gl.uniform1i(this.uniforms.viewTable ?? null, 1); // its own unit, even while it is empty: a unit has one type of texture
    this.viewName = "";
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  }

  /** Returns the shader's number for the look's curve; uploads the table of a view. Until that is loaded, the default curve. */
  curve() {
    const { gl, look } = this;
    if (!isView(look.curve)) return curveIndex(look.curve);
    if (this.viewName === look.curve) return VIEW_CURVE;
    const table = viewTable(look.curve, this.redraw);
    if (!table) return curveIndex("");
    gl.activeTexture(gl.TEXTURE1);
    gl.deleteTexture(gl.getParameter(gl.TEXTURE_BINDING_3D));
    gl.bindTexture(gl.TEXTURE_3D, gl.createTexture());
    gl.texStorage3D(gl.TEXTURE_3D, 1, gl.RGB10_A2, table.size, table.size, table.size);
    gl.texSubImage3D(
      ...[gl.TEXTURE_3D, 0, 0, 0, 0, table.size, table.size, table.size],
      ...[gl.RGBA, gl.UNSIGNED_INT_2_10_10_10_REV, table.words],
    );
    gl.texParameteri(gl.TEXTURE_3D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_3D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    gl.activeTexture(gl.TEXTURE0);
    this.viewName = look.curve;
    return VIEW_CURVE;
  }

  /**
   * Sets the size of the first layer's picture; the second is drawn at the same width.
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

  /** Aligns the canvas to device pixels, since layout yields fractional sizes. */
  resize() {
    const ratio = devicePixelRatio;
    const stage = /** @type {Element} */ (this.canvas.parentElement);
    const box = (stage.parentElement ?? stage).getBoundingClientRect(); // the stage fills it, and is scaled while the picture glides to its place
    const left = Math.ceil(box.left * ratio - 1e-3);
    const top = Math.ceil(box.top * ratio - 1e-3);
    const width = Math.max(1, Math.floor(box.right * ratio + 1e-3) - left);
    const height = Math.max(1, Math.floor(box.bottom * ratio + 1e-3) - top);
    for (const canvas of [this.canvas, this.over, ...(this.high ? [this.high.canvas] : [])]) {
      const style = {
        left: left / ratio - box.left,
        top: top / ratio - box.top,
        width: width / ratio,
        height: height / ratio,
      };
      for (const [name, value] of Object.entries(style)) canvas.style.setProperty(name, `${value}px`);
    }
    if (this.high) Object.assign(this.high.canvas, { width, height });
    if (width !== this.canvas.width || height !== this.canvas.height) {
      this.canvas.width = width;
      this.canvas.height = height;
      this.viewport.resizeCanvas(width, height);
      this.draw(); // immediately, since a resized canvas is blank until drawn
    }
  }

  invalidate() {
    this.pending ||= requestAnimationFrame(() => this.draw());
  }

  /**
   * Redraws for a new tile. A browser without a graphics card stops the page until a drawing is executed, which may take a second:
   * after each, the page is left idle for at least as long. All else is drawn at the next frame.
   *
   * @param {0 | 1} which layer
   */
  invalidateForTile(which) {
    const isHidden = this.cover.image !== null || (!this.sideBySide && (which === 0 ? this.wipe <= 0 : this.wipe >= 1));
    if (isHidden) return;
    if (this.resting === undefined) this.invalidate();
    else this.isOutdated = true;
  }

  /** Waits for the end of the drawing, then as long again, and redraws if tiles have arrived meanwhile. */
  rest() {
    const { gl } = this;
    const began = performance.now();
    const fence = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush(); // else the fence may not be reached
    const look = () => {
      if (fence && !gl.isContextLost() && gl.getSyncParameter(fence, gl.SYNC_STATUS) !== gl.SIGNALED) {
        this.resting = setTimeout(look, FENCE_MS);
        return;
      }
      gl.deleteSync(fence);
      this.resting = setTimeout(rested, Math.max(TILES_MS, performance.now() - began));
    };
    const rested = () => {
      this.resting = undefined;
      if (this.isOutdated) this.invalidate();
    };
    clearTimeout(this.resting);
    this.resting = setTimeout(look, 0);
  }

  draw() {
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    this.isOutdated = false;
    const { gl, canvas, wipe } = this;
    if (gl.isContextLost() || !this.uniforms) return;
    if (this.high && !this.high.begin(gl, canvas.width, canvas.height)) this.setHigh(null);
    gl.uniform1i(this.uniforms.high ?? null, this.high ? 1 : 0);
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
    if (this.high) {
      this.high.end(gl);
      gl.disable(gl.SCISSOR_TEST);
      gl.clear(gl.COLOR_BUFFER_BIT); // it lies under the other canvas, which is transparent beside the picture
    }
    this.rest();
    this.afterDraw();
  }

  /** @param {import("./high-range.js").HighRange | null} high */
  setHigh(high) {
    if (this.high === high) return;
    this.high?.dispose(this.gl);
    this.high = high;
    this.resize();
    this.invalidate();
  }

  /** The panes of the canvas that each show the picture: position, width, and offset from the viewport. */
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
   * Returns a layer's displayed pixels, RGBA, rows from the top; null if the layer is empty.
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
    gl.uniform1f(uniforms?.gain ?? null, layer.gainAt(look.exposure));
    gl.uniform1i(uniforms?.curve ?? null, this.curve());
    gl.uniform1i(uniforms?.part ?? null, 0);
    gl.uniform1i(uniforms?.hasAlpha ?? null, 0);
    gl.uniform1i(uniforms?.high ?? null, 0);
    gl.uniform1i(uniforms?.coding ?? null, layer.coding);
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
    if ((layer.film?.isBlank || layer.film?.isPartial) && !layer.image) return; // the element under the canvas stays visible
    gl.scissor(left, 0, width, canvas.height);
    gl.bindTexture(gl.TEXTURE_2D, layer.texture);
    gl.uniform1i(uniforms?.film ?? null, 0);
    gl.uniform2f(uniforms?.canvasSize ?? null, canvas.width, canvas.height);
    gl.uniform2f(uniforms?.origin ?? null, viewport.x + shift, viewport.y);
    gl.uniform1f(uniforms?.scale ?? null, (viewport.scale * viewport.picture.width) / layer.size.width);
    gl.uniform1f(uniforms?.gain ?? null, layer.gainAt(look.exposure));
    gl.uniform1i(uniforms?.curve ?? null, this.curve());
    gl.uniform1i(uniforms?.part ?? null, partIndex(look.part ?? ""));
    gl.uniform1i(uniforms?.hasAlpha ?? null, layer.hasAlpha ? 1 : 0);
    if (layer.hasAlpha) {
      gl.activeTexture(gl.TEXTURE2);
      gl.bindTexture(gl.TEXTURE_2D, layer.alphaTexture);
      gl.activeTexture(gl.TEXTURE0);
      gl.uniform1i(uniforms?.alpha ?? null, 2);
      gl.uniform1f(uniforms?.square ?? null, SQUARE * devicePixelRatio);
    }
    gl.uniform1i(uniforms?.coding ?? null, layer.coding);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }

  dispose() {
    this.high?.dispose(this.gl);
    this.high = null;
    for (const layer of [...this.layers, this.cover]) layer.clear();
    cancelAnimationFrame(this.pending);
    clearTimeout(this.resting);
    this.gl.getExtension("WEBGL_lose_context")?.loseContext(); // browsers allow only some 16 contexts
  }
}
