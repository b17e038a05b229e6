/**
 * The picture on the page, or two at a wipe: the WebGL canvas, its overlays, and mouse input. Independent of jobs: it gets
 * layers and a look, and reports the pixel under the cursor.
 */

import { h } from "../base/dom.js";
import { FilmCanvas } from "./film-canvas.js";
import { highRangeOn } from "./high-range.js";
import { panAndZoom } from "./pan-zoom.js";
import { PixelOverlay } from "./pixel-overlay.js";
import { Poster, placeOver } from "./poster.js";
import { Viewport } from "./viewport.js";
import { t } from "../base/words.js";

/** @typedef {import("./film-canvas.js").Look} Look */

/** Durations, in milliseconds, in which a picture fades into a better one, and moves from where the page before had it. */
const [FADE_MS, GLIDE_MS] = [200, 200];

/** Whether the user prefers pages without motion. */
const prefersStill = () => matchMedia("(prefers-reduced-motion: reduce)").matches;

/**
 * @typedef {object} FilmHandlers
 * @property {(at: {x: number, y: number} | null, byKeys: boolean) => void} cursor the pixel under it changed; null: none is
 * @property {() => void} moved the viewport may have changed
 */

export class FilmView {
  /**
   * @param {number} width of the picture, in pixels; a second one is shown as wide
   * @param {number} height
   * @param {FilmHandlers} handlers
   */
  constructor(width, height, handlers) {
    this.handlers = handlers;
    this.viewport = new Viewport();
    const canvas = h("canvas", { class: "film", role: "img", "aria-label": t("The picture") });
    const overlay = h("canvas", { class: "over", "aria-hidden": "true" });
    this.edge = h("div", { class: "edge", "aria-hidden": "true", hidden: true });
    this.element = h("div", { class: "stage" }, canvas, this.edge, overlay);
    this.size = { width, height };
    this.over = new PixelOverlay(overlay, this.viewport, { width, height }, (cx) => this.filmAt(cx));
    this.canvas = new FilmCanvas(canvas, overlay, this.viewport);
    this.over.panes = () => this.canvas.panes();
    this.canvas.setPicture(width, height);
    this.layers = this.canvas.layers;
    /** @type {Poster | null} */
    this.poster = null;
    this.wantsHigh = false;
    this.isDisposed = false;
    /** Where the page before had the picture, until this one has moved it to its place. @type {DOMRect | null} */
    this.origin = null;
    /** What fades out over the picture that replaces it. @type {HTMLElement | null} */
    this.fading = null;
    for (const layer of this.layers) layer.beforeFade = () => this.fade();
    this.canvas.afterDraw = () => {
      this.over.draw();
      this.placePoster();
      this.edge.hidden = this.canvas.sideBySide || !canvas.style.width;
      placeOver(this.edge, this.viewport, canvas);
      this.glide();
      // The picture's position, for tests that compare screenshots with films.
      const { scale, x, y } = this.viewport;
      const place = `${scale} ${x} ${y}`;
      if (place !== this.element.dataset.view) this.endFade();
      this.element.dataset.view = place;
      handlers.moved();
    };
    /** @param {MouseEvent} event */
    const place = (event) => {
      const box = canvas.getBoundingClientRect();
      const x = (event.clientX - box.left) * devicePixelRatio;
      const pane = this.canvas.panes().findLast(({ left }) => x >= left);
      return { x: x - (pane?.shift ?? 0), y: (event.clientY - box.top) * devicePixelRatio };
    };
    this.place = place;
    this.undoPan = panAndZoom(this.element, place, this.viewport, () => this.canvas.invalidate());
    this.resizing = new ResizeObserver(() => this.canvas.resize());
    this.resizing.observe(this.element);
    this.element.addEventListener("pointermove", (event) => this.pointAt(event));
    this.element.addEventListener("pointerleave", (event) => event.pointerType === "mouse" && this.setCursor(null));
    this.element.addEventListener("pointerdown", (event) => this.pointAt(event));
    this.element.addEventListener("dblclick", () => this.fit());
  }

  /** @param {number} fraction of the stage's width that the first picture has; the second has the rest */
  setWipe(fraction) {
    this.canvas.wipe = fraction;
    this.canvas.invalidate();
  }

  /** Shows the pictures side by side, or both at the wipe. @param {boolean} on */
  setSideBySide(on) {
    if (this.canvas.sideBySide === on) return;
    this.canvas.sideBySide = on;
    this.viewport.across = on ? 2 : 1;
    this.viewport.fit();
    this.canvas.invalidate();
  }

  /**
   * Shows an image over the pictures.
   * @param {ImageBitmap | null} image it is this view's from now on; null: the pictures again
   */
  setCover(image) {
    if (image) this.canvas.cover.setImage(image);
    else if (this.canvas.cover.image) this.canvas.cover.clear();
    this.canvas.invalidate();
  }

  /**
   * Returns the film shown at a canvas position; null for an image, whose values are not the film's.
   *
   * @param {number} cx device pixels
   */
  filmAt(cx) {
    if (this.canvas.cover.image) return null;
    const split = this.canvas.sideBySide ? 0.5 : this.canvas.wipe;
    const layer = this.layers[cx < split * this.viewport.canvas.width ? 0 : 1];
    return layer.image ? null : layer.film;
  }

  /** Sets the image shown until the film has samples. @param {string | null} url of an image; null: black @param {string} [sharp] of a denoised one in full resolution; "": none @param {string} [nearest] of a smaller one that the browser has; "": none */
  setPoster(url, sharp, nearest) {
    this.poster?.element.remove();
    this.poster = new Poster(url, sharp, nearest);
    this.element.prepend(this.poster.element);
    this.placePoster();
  }

  placePoster() {
    if (!this.poster) return;
    const { wipe, sideBySide } = this.canvas;
    const films = [(sideBySide || wipe > 0) && this.layers[0], (sideBySide || wipe < 1) && this.layers[1]].flatMap((layer) => layer || []).map(({ film }) => film);
    if (films.some((film) => film?.isBlank !== false || film.isPartial)) {
      this.poster.place(this.viewport, this.canvas.canvas);
      return;
    }
    this.fadeOut(this.poster.element);
    this.poster = null;
    this.element.dataset.film = "here";
  }

  /** Moves the picture once from where the page before had it. */
  glide() {
    const { origin, viewport, canvas } = this;
    const { style } = canvas.canvas;
    if (!origin?.width || !style.width) return; // not laid out yet
    this.origin = null;
    if (prefersStill()) return;
    const stage = this.element.getBoundingClientRect();
    const ratio = devicePixelRatio;
    const scale = (origin.width * ratio) / (viewport.picture.width * viewport.scale);
    const x = origin.left - stage.left - scale * (parseFloat(style.left) + viewport.x / ratio);
    const y = origin.top - stage.top - scale * (parseFloat(style.top) + viewport.y / ratio);
    if (Math.abs(x) < 1 && Math.abs(y) < 1 && Math.abs(scale - 1) < 0.01) return;
    const from = { transform: `translate(${x}px, ${y}px) scale(${scale})`, transformOrigin: "0 0" };
    this.element.animate([from, { transform: "none", transformOrigin: "0 0" }], { duration: GLIDE_MS, easing: "cubic-bezier(0.2, 0, 0, 1)" });
  }

  /** Keeps what is shown over the canvas while it fades; called before a picture is replaced. */
  fade() {
    const { canvas } = this.canvas;
    if (this.poster || this.canvas.high || this.isDisposed || prefersStill() || !canvas.style.width || document.hidden) return; // a poster fades itself
    const copy = h("canvas", { "aria-hidden": "true", width: canvas.width, height: canvas.height });
    copy.style.cssText = canvas.style.cssText;
    this.canvas.draw(); // WebGL keeps its picture only until the next frame
    copy.getContext("2d")?.drawImage(canvas, 0, 0);
    this.fadeOut(copy);
  }

  /** Lays an element over the canvas, and removes it once it has faded. @param {HTMLElement} element */
  fadeOut(element) {
    this.endFade();
    if (prefersStill()) return element.remove();
    this.canvas.canvas.after(element);
    this.fading = element;
    element.classList.add("fading");
    element.animate([{ opacity: 1 }, { opacity: 0 }], { duration: FADE_MS, easing: "ease-in-out", fill: "forwards" }).onfinish = () => element.remove();
  }

  endFade() {
    this.fading?.remove();
    this.fading = null;
  }

  /** Shows the picture with the display's high dynamic range, where that can be had. @param {boolean} on */
  async setHighRange(on) {
    if (on === this.wantsHigh) return;
    this.wantsHigh = on;
    if (!on) {
      this.canvas.setHigh(null);
      return;
    }
    const canvas = h("canvas", { class: "high-range", "aria-hidden": "true" });
    const high = await highRangeOn(canvas);
    if (!high || !this.wantsHigh || this.isDisposed) {
      high?.device.destroy();
      return;
    }
    void high.device.lost.then(() => this.canvas.high === high && this.canvas.setHigh(null));
    this.canvas.canvas.after(canvas);
    this.canvas.setHigh(high);
  }

  /** @param {Look} look */
  setLook(look) {
    void this.setHighRange(look.high === true);
    this.canvas.look = look;
    this.over.exposure = look.exposure;
    this.canvas.invalidate();
  }

  /** @param {import("./pixel-overlay.js").Outline[]} outlines */
  setOutlines(outlines) {
    if (!outlines.length && !this.over.outlines.length) return;
    this.over.outlines = outlines;
    this.over.draw();
  }

  /** @param {PointerEvent} event */
  pointAt(event) {
    const { x, y } = this.place(event);
    const at = this.viewport.pixelAt(x, y);
    const { width, height } = this.size;
    this.setCursor(at.x >= 0 && at.y >= 0 && at.x < width && at.y < height ? at : null);
  }

  /** @param {{x: number, y: number} | null} at @param {boolean} [byKeys] */
  setCursor(at, byKeys = false) {
    const was = this.over.cursor;
    if (was?.x === at?.x && was?.y === at?.y) return;
    this.over.cursor = at;
    this.over.draw();
    this.handlers.cursor(at, byKeys);
  }

  /**
   * Moves the inspected pixel by keys, starting at the centre.
   *
   * @param {number} dx
   * @param {number} dy
   */
  moveCursor(dx, dy) {
    const { width, height } = this.size;
    const { x, y } = this.over.cursor ?? { x: Math.floor(width / 2) - dx, y: Math.floor(height / 2) - dy };
    this.setCursor({ x: Math.min(Math.max(x + dx, 0), width - 1), y: Math.min(Math.max(y + dy, 0), height - 1) }, true);
  }

  fit() {
    this.viewport.fit();
    this.canvas.invalidate();
  }

  actualSize() {
    this.viewport.actualSize();
    this.canvas.invalidate();
  }

  /** @param {1 | -1} direction */
  zoom(direction) {
    this.viewport.step(direction);
    this.canvas.invalidate();
  }

  dispose() {
    this.isDisposed = true;
    this.undoPan();
    this.resizing.disconnect();
    this.canvas.dispose();
  }
}
