/** The film of one job as it grows: its live connection, and who wants to know of new samples. */

import { putJob, setLink } from "./farm.js";
import { Film } from "./film.js";
import { Live } from "./live.js";
import { firstFrame } from "./shot/shot-words.js";
import { showError } from "./tray.js";

/** @typedef {import("./types.js").Job} Job */
/** @typedef {import("./tile-packet.js").TilePacket} TilePacket */

export class LiveFilm {
  /** @param {Job} job of known size */
  constructor(job) {
    this.job = job.id;
    /** Which of its pictures this is. */
    this.frame = firstFrame(job);
    /** Whether no more samples are to come. */
    this.finished = job.state === "finished";
    this.film = new Film(job.width ?? 1, job.height ?? 1);
    /** @type {Set<(tile: TilePacket) => void>} */
    this.listeners = new Set();
    this.link = `live ${job.id}`;
    this.live = new Live(job.id, {
      tile: (tile) => {
        this.film.put(tile);
        for (const listener of this.listeners) listener(tile);
      },
      message: (message) => {
        if (message.type !== "state") return;
        this.finished = message.job.state === "finished";
        putJob(message.job);
      },
      link: (up) => setLink(this.link, up),
      refused: (sentence) =>
        showError("The live picture ended", sentence, {
          action: { label: "Reload the page", run: () => location.reload() },
        }),
    });
  }

  /** @param {(tile: TilePacket) => void} listener @returns {() => void} ends it */
  onTile(listener) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  dispose() {
    this.live.close();
    setLink(this.link, true);
  }
}
