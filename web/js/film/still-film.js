/** A film that does not change: a snapshot of a job, or an uploaded picture. Same interface as LiveFilm. */

import { fetchPacket } from "../news/api.js";
import { Film } from "./film.js";

/** @typedef {import("../news/tile-packet.js").TilePacket} TilePacket */

export class StillFilm {
  /**
   * @param {string} url of the film
   * @param {{width: number, height: number}} size
   * @param {{job?: string, hasSamples?: boolean}} [of] hasSamples: false of a picture that no farm has rendered
   */
  constructor(url, { width, height }, { job = "", hasSamples = true } = {}) {
    this.url = url;
    this.job = job;
    this.frame = 0;
    this.finished = true;
    this.hasSamples = hasSamples;
    this.film = new Film(width, height);
    this.fetching = new AbortController();
    /** @type {Set<() => void>} */
    this.filled = new Set();
    /** Resolves once loaded; rejects with the error. */
    this.ready = this.fetch();
    this.ready.catch(() => {}); // reported by the view that shows it
  }

  async fetch() {
    const packet = await fetchPacket(this.url, this.fetching.signal);
    this.film.take(packet);
    for (const listener of this.filled) listener();
  }

  /** @param {() => void} listener it is here @returns {() => void} ends it */
  onFill(listener) {
    this.filled.add(listener);
    return () => this.filled.delete(listener);
  }

  /** Never called, since no tiles follow. @param {(tile: TilePacket) => void} listener @returns {() => void} */
  onTile(listener) {
    return () => void listener;
  }

  /** Never called, since there is only one frame. @param {() => void} listener @returns {() => void} */
  onTurn(listener) {
    return () => void listener;
  }

  dispose() {
    this.fetching.abort();
    this.filled.clear();
  }
}
