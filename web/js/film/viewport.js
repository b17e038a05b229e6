/**
 * Position of a picture on the canvas: a scale (device pixels per picture pixel) and the canvas position of the picture's upper
 * left corner, in device pixels. Pure arithmetic, independent of the canvas and the mouse.
 */

const MIN_SCALE = 1 / 64;
const MAX_SCALE = 256;

/** Zoom levels for keyboard zooming: powers of two and steps between them. */
const STOPS = [
  1 / 64,
  1 / 32,
  1 / 16,
  1 / 8,
  1 / 6,
  1 / 4,
  1 / 3,
  1 / 2,
  2 / 3,
  1,
  2,
  3,
  4,
  6,
  8,
  12,
  16,
  24,
  32,
  48,
  64,
  96,
  128,
  192,
  256,
];

export class Viewport {
  constructor() {
    this.scale = 1;
    this.x = 0;
    this.y = 0;
    /** Whether to follow the canvas' size, until the user zooms or pans. */
    this.fitted = true;
    this.canvas = { width: 1, height: 1 };
    /** Whether the picture fits at any scale, for a canvas of its shape. */
    this.isSnug = false;
    /** Number of pictures side by side on the canvas. */
    this.across = 1;
    this.picture = { width: 1, height: 1 };
  }

  /** Sets the largest scale that shows the whole picture; integers above 4, where uneven pixels would show. */
  fit() {
    const { picture } = this;
    const canvas = { width: this.canvas.width / this.across, height: this.canvas.height };
    const scale = Math.min(canvas.width / picture.width, canvas.height / picture.height);
    this.scale = clamp(scale > 4 && !this.isSnug ? Math.floor(scale) : scale);
    this.centre();
    this.fitted = true;
  }

  /** Returns what the canvas shows beside a fitted picture and above it, in device pixels; 0 for another place, and for pictures side by side. */
  margins() {
    const isOne = this.fitted && this.across === 1;
    return { beside: isOne ? Math.max(this.x, 0) : 0, above: isOne ? Math.max(this.y, 0) : 0 };
  }

  /** Sets one picture pixel per device pixel, around the canvas' centre. */
  actualSize() {
    this.zoomTo(1, this.canvas.width / 2, this.canvas.height / 2);
  }

  centre() {
    this.x = Math.round((this.canvas.width - this.picture.width * this.scale) / 2);
    this.y = Math.round((this.canvas.height - this.picture.height * this.scale) / 2);
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  resizeCanvas(width, height) {
    const dx = (width - this.canvas.width) / 2;
    const dy = (height - this.canvas.height) / 2;
    this.canvas = { width, height };
    if (this.fitted) this.fit();
    else this.pan(dx, dy);
  }

  /**
   * @param {number} width
   * @param {number} height
   */
  setPicture(width, height) {
    this.picture = { width, height };
    if (this.fitted) this.fit();
  }

  /**
   * Sets the scale while keeping the picture point under (cx, cy) in place.
   *
   * @param {number} scale
   * @param {number} cx
   * @param {number} cy
   */
  zoomTo(scale, cx, cy) {
    const next = clamp(scale);
    const px = (cx - this.x) / this.scale;
    const py = (cy - this.y) / this.scale;
    this.scale = next;
    this.x = Math.round(cx - px * next);
    this.y = Math.round(cy - py * next);
    this.fitted = false;
    this.keepInSight();
  }

  /**
   * Zooms to the next level up or down, around the canvas' centre.
   *
   * @param {1 | -1} direction
   */
  step(direction) {
    const next =
      direction > 0 ? STOPS.find((s) => s > this.scale * 1.001) : STOPS.findLast((s) => s < this.scale * 0.999);
    this.zoomTo(next ?? this.scale, this.canvas.width / 2, this.canvas.height / 2);
  }

  /**
   * @param {number} dx
   * @param {number} dy
   */
  pan(dx, dy) {
    this.x = Math.round(this.x + dx);
    this.y = Math.round(this.y + dy);
    this.fitted = false;
    this.keepInSight();
  }

  /** Keeps a strip of the picture visible while panning. */
  keepInSight() {
    const strip = 40;
    const w = this.picture.width * this.scale;
    const h = this.picture.height * this.scale;
    this.x = Math.round(Math.min(Math.max(this.x, strip - w), this.canvas.width - strip));
    this.y = Math.round(Math.min(Math.max(this.y, strip - h), this.canvas.height - strip));
  }

  /** Returns the picture point at the canvas' centre. */
  middle() {
    return { x: (this.canvas.width / 2 - this.x) / this.scale, y: (this.canvas.height / 2 - this.y) / this.scale };
  }

  /**
   * Centres a picture point on the canvas.
   *
   * @param {number} scale
   * @param {number} px
   * @param {number} py
   */
  show(scale, px, py) {
    this.scale = clamp(scale);
    this.x = Math.round(this.canvas.width / 2 - px * this.scale);
    this.y = Math.round(this.canvas.height / 2 - py * this.scale);
    this.fitted = false;
  }

  /**
   * Returns the picture pixel under a canvas point, which may be outside the picture.
   *
   * @param {number} cx
   * @param {number} cy
   */
  pixelAt(cx, cy) {
    return { x: Math.floor((cx - this.x) / this.scale), y: Math.floor((cy - this.y) / this.scale) };
  }
}

/** @param {number} scale */
function clamp(scale) {
  return Math.min(Math.max(scale, MIN_SCALE), MAX_SCALE);
}
