/**
 * The overlay of the picture on a separate 2D canvas: pixel values at high zoom, a frame around the pixel under the cursor, and
 * outlines of the tiles that workers are rendering.
 */

import { luminanceOf } from "../base/colour.js";
import { radiance } from "../base/format.js";

/** The page's typeface, as web/css/tokens.css has it, for text that is drawn on a canvas. */
export const SANS = '"Inter", system-ui, sans-serif';

/** @typedef {import("./film.js").Film} Film */
/** @typedef {import("./viewport.js").Viewport} Viewport */
/** @typedef {{x: number, y: number, w: number, h: number, label: string, short: string, worker: string, colour: string}} Outline */
/** An additional drawing over the picture. @typedef {(over: PixelOverlay, ratio: number) => void} Mark */

/** Minimum size of a picture pixel, in CSS pixels, at which its three values fit. */
const VALUES_FROM = 44;
/** Minimum size of a picture pixel, in CSS pixels, at which it is framed under the cursor. */
const CURSOR_FROM = 6;

export class PixelOverlay {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {Viewport} viewport
   * @param {{width: number, height: number}} size of the picture
   * @param {(cx: number) => Film | null} filmAt returns the film whose values are shown at canvas position cx
   */
  constructor(canvas, viewport, size, filmAt) {
    this.canvas = canvas;
    this.viewport = viewport;
    this.size = size;
    this.filmAt = filmAt;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    /** @type {{x: number, y: number} | null} */
    this.cursor = null;
    /** @type {Outline[]} */
    this.outlines = [];
    /** Marks on the picture, by the name of their owner. @type {Map<string, Mark>} */
    this.marks = new Map();
    this.exposure = 0;
    /** As in FilmCanvas. */
    this.panes = () => [{ left: 0, width: viewport.canvas.width, shift: 0 }];
  }

  /** @param {string} name @param {Mark | null} mark null: takes it away */
  setMark(name, mark) {
    if (!mark && !this.marks.has(name)) return;
    if (mark) this.marks.set(name, mark);
    else this.marks.delete(name);
    this.draw();
  }

  draw() {
    const { canvas, context, viewport } = this;
    const { width, height } = viewport.canvas;
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, { width, height });
    context.clearRect(0, 0, width, height);
    const ratio = devicePixelRatio;
    const values = viewport.scale >= VALUES_FROM * ratio;
    const cursor = viewport.scale >= CURSOR_FROM * ratio ? this.cursor : null;
    // Chromium may keep showing a canvas that was cleared and not drawn again.
    canvas.hidden = !values && !cursor && this.outlines.length === 0 && this.marks.size === 0;
    for (const { left, width: part, shift } of this.panes()) {
      context.save();
      context.beginPath();
      context.rect(left, 0, part, height);
      context.clip();
      context.translate(shift, 0);
      for (const outline of this.outlines) this.drawOutline(outline);
      if (values) this.drawValues(ratio, shift);
      for (const mark of this.marks.values()) mark(this, ratio);
      if (cursor) this.strokeTwice(cursor.x, cursor.y, 1, 1);
      context.restore();
    }
  }

  /** @param {Outline} outline */
  drawOutline({ x, y, w, h, label, short, colour }) {
    this.strokeTwice(x, y, w, h, { corners: true, colour });
    const { context, viewport } = this;
    const ratio = devicePixelRatio;
    context.font = `600 ${12 * ratio}px ${SANS}`;
    const room = w * viewport.scale - 8 * ratio;
    const fits = [label, short].find((text) => context.measureText(text).width < room);
    if (!fits || h * viewport.scale < 18 * ratio) return;
    this.text(fits, viewport.x + x * viewport.scale + 4 * ratio, viewport.y + y * viewport.scale + 12 * ratio, colour, ratio);
  }

  /**
   * A light line inside a dark one, visible on any picture.
   *
   * @param {number} x
   * @param {number} y
   * @param {number} w
   * @param {number} h
   * @param {{corners?: boolean, colour?: string, dash?: boolean}} [look] only the corners, as render buckets are shown
   */
  strokeTwice(x, y, w, h, { corners = false, colour = "#fff", dash = false } = {}) {
    const { context, viewport } = this;
    const left = Math.round(viewport.x + x * viewport.scale);
    const top = Math.round(viewport.y + y * viewport.scale);
    const right = Math.round(viewport.x + (x + w) * viewport.scale);
    const bottom = Math.round(viewport.y + (y + h) * viewport.scale);
    const ratio = devicePixelRatio;
    const arm = corners ? Math.min(10 * ratio, (right - left) / 3, (bottom - top) / 3) : 0;
    for (const [style, line] of /** @type {const} */ ([
      ["rgb(0 0 0 / 0.75)", 3 * ratio],
      [colour, 1.25 * ratio],
    ])) {
      context.strokeStyle = style;
      context.lineWidth = line;
      context.setLineDash(dash && style === colour ? [6 * ratio, 4 * ratio] : []);
      context.beginPath();
      if (corners) {
        for (const [cx, sx] of /** @type {const} */ ([
          [left, 1],
          [right, -1],
        ])) {
          for (const [cy, sy] of /** @type {const} */ ([
            [top, 1],
            [bottom, -1],
          ])) {
            context.moveTo(cx + sx * arm, cy);
            context.lineTo(cx, cy);
            context.lineTo(cx, cy + sy * arm);
          }
        }
      } else {
        context.rect(left, top, right - left, bottom - top);
      }
      context.stroke();
    }
    context.setLineDash([]);
  }

  /** @param {number} ratio @param {number} shift of the picture, to the right */
  drawValues(ratio, shift) {
    const { context, viewport } = this;
    const size = Math.min(12, (viewport.scale / ratio) * 0.17) * ratio;
    context.font = `${size}px ui-monospace, monospace`;
    context.textAlign = "center";
    const from = viewport.pixelAt(-shift, 0);
    const to = viewport.pixelAt(viewport.canvas.width - shift, viewport.canvas.height);
    for (let y = Math.max(0, from.y); y <= Math.min(this.size.height - 1, to.y); y++) {
      for (let x = Math.max(0, from.x); x <= Math.min(this.size.width - 1, to.x); x++) {
        const cx = viewport.x + (x + 0.5) * viewport.scale;
        const film = this.filmAt(cx + shift);
        if (film?.width !== this.size.width) continue; // of another size, so its pixels differ
        const { rgb } = film.at(x, y);
        const luminance = luminanceOf(rgb) * 2 ** this.exposure;
        const ink = luminance > 0.18 ? "#000" : "#fff";
        const cy = viewport.y + (y + 0.5) * viewport.scale;
        rgb.forEach((value, i) => this.text(radiance(value), cx, cy + (i - 0.65) * size * 1.35, ink, 0));
      }
    }
    context.textAlign = "start";
  }

  /**
   * @param {string} text
   * @param {number} x
   * @param {number} y
   * @param {string} ink
   * @param {number} halo width of a dark outline; 0 for none
   */
  text(text, x, y, ink, halo) {
    const { context } = this;
    if (halo) {
      context.strokeStyle = "rgb(0 0 0 / 0.75)";
      context.lineWidth = 3 * halo;
      context.lineJoin = "round";
      context.strokeText(text, x, y);
    }
    context.fillStyle = ink;
    context.fillText(text, x, y);
  }
}
