/** The film of the live view as a side of a stage: without a job, and of a size that the farm chooses. */

import { Film } from "../film/film.js";
import { enlarged } from "./enlarge.js";

/** @typedef {import("./view-packet.js").ViewTile} TilePacket */

export class ViewFilm {
  constructor() {
    this.job = "";
    this.frame = 0;
    this.finished = false;
    this.film = new Film(1, 1);
    /** @type {Set<(tile: TilePacket) => void>} */
    this.listeners = new Set();
    /** @type {Set<() => void>} */
    this.turned = new Set();
    /** @type {Set<() => void>} */
    this.filled = new Set();
  }

  /** @param {import("./view-packet.js").ViewPicture} next */
  take({ width, height, tiles }) {
    const before = this.film;
    this.takeColour({ width, height, tiles });
    this.film.coverage = coverageOf(before, this.film, tiles);
    if (this.film.coverage || before.coverage) for (const listener of this.filled) listener();
  }

  /** @param {Pick<import("./view-packet.js").ViewPicture, "width" | "height" | "tiles">} next */
  takeColour({ width, height, tiles }) {
    if (this.film.width === width && this.film.height === height && !this.film.isBlank) {
      for (const tile of tiles) {
        this.film.put(tile);
        for (const listener of this.listeners) listener(tile);
      }
      return;
    }
    // Missing tiles keep showing the previous picture.
    const covered = tiles.reduce((sum, { w, h: rows }) => sum + w * rows, 0);
    const isWhole = covered === width * height || this.film.isBlank;
    this.film = isWhole ? new Film(width, height) : enlarged(this.film, width, height);
    for (const tile of tiles) this.film.put(tile);
    for (const listener of this.turned) listener();
  }

  /** @param {(tile: TilePacket) => void} listener @returns {() => void} ends it */
  onTile(listener) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  /** @param {() => void} listener the film is another @returns {() => void} ends it */
  onTurn(listener) {
    this.turned.add(listener);
    return () => this.turned.delete(listener);
  }

  /** All colour arrives as tiles; the coverage of a picture before a transparent background comes after them. @param {() => void} listener @returns {() => void} ends it */
  onFill(listener) {
    this.filled.add(listener);
    return () => this.filled.delete(listener);
  }
}

/**
 * The coverage of a picture after tiles have arrived; pixels of no tile keep that of the previous picture.
 *
 * @param {Film} before of any size
 * @param {Film} after
 * @param {TilePacket[]} tiles
 * @returns {Uint8Array | null}
 */
function coverageOf(before, { width, height }, tiles) {
  if (!tiles.some(({ alpha }) => alpha)) return tiles.length ? null : before.coverage;
  const bytes = new Uint8Array(width * height).fill(255);
  if (before.coverage)
    for (let y = 0; y < height; y++) {
      const row = Math.floor((y * before.height) / height) * before.width;
      for (let x = 0; x < width; x++) bytes[y * width + x] = before.coverage[row + Math.floor((x * before.width) / width)] ?? 255;
    }
  for (const { x, y, w, h, alpha } of tiles)
    for (let row = 0; alpha && row < h; row++) bytes.set(alpha.subarray(row * w, (row + 1) * w), (y + row) * width + x);
  return bytes;
}
