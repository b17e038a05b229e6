/** The film of the live view as a side of a stage: without a job, and of a size that the farm chooses. */

import { Film } from "../film/film.js";
import { enlarged } from "./enlarge.js";

/** @typedef {import("../news/tile-packet.js").TilePacket} TilePacket */

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
  }

  /** @param {import("./view-packet.js").ViewPicture} next */
  take({ width, height, tiles }) {
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

  /** Never called, since all updates arrive as tiles. @returns {() => void} */
  onFill() {
    return () => {};
  }
}
