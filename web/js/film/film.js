/** The page's copy of a frame: the mean of every pixel as RGB9E5, with its number of samples. */

import { brightnessOf } from "./brightness.js";
import { decode } from "./rgb9e5.js";

/** @typedef {import("../news/tile-packet.js").TilePacket} TilePacket */

/** Place of an RGB9E5 word's exponent, which is 0 for colours below 2^-15. */
const EXPONENT_SHIFT = 27;

export class Film {
  /**
   * @param {number} width
   * @param {number} height
   * @param {Uint32Array} [given] RGB9E5, rows from the top; black where left out
   */
  constructor(width, height, given) {
    const words = given ?? new Uint32Array(width * height);
    if (words.length !== width * height)
      throw new Error(`A picture of ${width}×${height} came with ${words.length} words.`);
    this.width = width;
    this.height = height;
    this.words = words;
    this.samples = new Uint32Array(width * height);
    /** Of a live view before a transparent background, 0 to 255; null: opaque, or the alpha comes separately. @type {Uint8Array | null} */
    this.coverage = null;
    /** Number of samples over all pixels. */
    this.total = 0;
    /** Whether no tile has arrived yet. */
    this.isBlank = given === undefined;
    /** Whether single tiles have arrived while the whole film is still being fetched; the other pixels are black. */
    this.isPartial = false;
    /** Whether it is a live view's that was denoised. */
    this.isDenoised = false;
  }

  /** @param {TilePacket} tile */
  put({ x, y, w, h, spp, words }) {
    if (x + w > this.width || y + h > this.height) return; // from a job of another size
    this.isBlank = false;
    for (let row = 0; row < h; row++) {
      const at = (y + row) * this.width + x;
      this.words.set(words.subarray(row * w, (row + 1) * w), at);
      for (let i = at; i < at + w; i++) this.total += spp - (this.samples[i] ?? 0);
      this.samples.fill(spp, at, at + w);
    }
  }

  /**
   * Merges a whole film: the tiles that have more samples than here.
   *
   * @param {import("../news/tile-packet.js").FilmPacket} packet
   */
  take({ width, height, side, spp, words }) {
    if (width !== this.width || height !== this.height) return;
    let tile = 0;
    for (let y = 0; y < height; y += side) {
      for (let x = 0; x < width; x += side) {
        const samples = spp[tile++] ?? 0;
        if (samples <= (this.samples[y * width + x] ?? 0)) continue;
        this.isBlank = false;
        const right = Math.min(x + side, width);
        for (let row = y; row < Math.min(y + side, height); row++) {
          const [from, to] = [row * width + x, row * width + right];
          this.total += (samples - (this.samples[from] ?? 0)) * (right - x);
          this.words.set(words.subarray(from, to), from);
          this.samples.fill(samples, from, to);
        }
      }
    }
  }

  /** Returns the samples per pixel of every tile, in reading order. @param {number} side of a tile @returns {number[]} */
  tileSamples(side) {
    const found = [];
    for (let y = 0; y < this.height; y += side)
      for (let x = 0; x < this.width; x += side) found.push(this.samples[y * this.width + x] ?? 0);
    return found;
  }

  /**
   * Resets to black, or to another picture until there are samples.
   *
   * @param {Film | null} [other] of any size
   */
  restart(other = null) {
    this.samples.fill(0);
    this.total = 0;
    this.isBlank = false;
    this.isPartial = false;
    this.coverage = other?.coverage ? new Uint8Array(this.words.length) : null;
    if (!other) {
      this.words.fill(0);
      return;
    }
    for (let y = 0; y < this.height; y++) {
      const row = Math.floor((y * other.height) / this.height) * other.width;
      for (let x = 0; x < this.width; x++) {
        const from = row + Math.floor((x * other.width) / this.width);
        this.words[y * this.width + x] = other.words[from] ?? 0;
        if (this.coverage) this.coverage[y * this.width + x] = other.coverage?.[from] ?? 255;
      }
    }
  }

  /**
   * @param {number} x
   * @param {number} y
   */
  contains(x, y) {
    return x >= 0 && y >= 0 && x < this.width && y < this.height;
  }

  /**
   * @param {number} x
   * @param {number} y
   * @returns {{rgb: [number, number, number], samples: number}}
   */
  at(x, y) {
    const i = y * this.width + x;
    return { rgb: decode(this.words[i] ?? 0), samples: this.samples[i] ?? 0 };
  }

  /** Returns its brightness. A transparent background does not count. */
  brightness() {
    return brightnessOf(this.words.length, (i) => (!this.samples[i] || this.coverage?.[i] === 0 ? null : decode(this.words[i] ?? 0)));
  }

  /** Whether every pixel has samples, and all are black: exactly so, but for a few in which a denoiser leaves less than 2^-15. */
  isBlack() {
    const isFaint = (/** @type {number} */ word, /** @type {number} */ i) => word >>> EXPONENT_SHIFT === 0 && (this.samples[i] ?? 0) > 0;
    return !this.isPartial && this.words.every(isFaint) && this.brightness().white === 0;
  }

  /**
   * Returns the exposure in stops that maps all but the brightest pixels below 1; null while the film is black.
   *
   * @returns {number | null}
   */
  normalisingExposure() {
    const { white } = this.brightness();
    return white > 0 ? -Math.log2(white) : null;
  }
}
