/** The film of one job as it grows: its live connection, and who wants to know of new samples. */

import { putJob, setLink } from "../news/farm.js";
import { Film } from "./film.js";
import { Live } from "../news/live.js";
import { firstFrame } from "../base/shot-words.js";
import { showError } from "../shell/tray.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../news/tile-packet.js").TilePacket} TilePacket */

export class LiveFilm {
  /** @param {Job} job of known size @param {number} [frame] */
  constructor(job, frame = firstFrame(job)) {
    this.job = job.id;
    /** Which of its pictures this is; `turnTo` goes to another. */
    this.frame = frame;
    /** Whether no more samples are to come. */
    this.finished = job.state === "finished";
    this.film = new Film(job.width ?? 1, job.height ?? 1);
    /** @type {Set<(tile: TilePacket) => void>} */
    this.listeners = new Set();
    /** @type {Set<() => void>} */
    this.turned = new Set();
    /** Of a shot: told of frames that changed. @type {(frames: import("../base/types.js").Frame[]) => void} */
    this.framesChanged = () => {};
    this.link = `live ${job.id}`;
    this.live = new Live(job.id, frame, {
      tile: (tile) => {
        if (tile.frame !== Math.floor(this.frame) % 65536) return; // of the frame before
        this.film.put(tile);
        for (const listener of this.listeners) listener(tile);
      },
      message: (message) => {
        if (message.type === "frames") this.framesChanged(message.frames);
        if (message.type !== "state") return;
        this.finished = message.job.state === "finished";
        putJob(message.job);
      },
      link: (up) => setLink(this.link, up),
      refused: (sentence) =>
        showError("The live picture ended", sentence, {
          ofPage: true,
          action: { label: "Reload the page", run: () => location.reload() },
        }),
    });
  }

  /** @param {(tile: TilePacket) => void} listener @returns {() => void} ends it */
  onTile(listener) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  /**
   * Goes to another frame of the shot.
   *
   * @param {number} frame
   * @param {Film | null} meanwhile what is shown until its tiles are here
   */
  turnTo(frame, meanwhile) {
    this.frame = frame;
    this.film.restart(meanwhile);
    this.live.turnTo(frame);
    for (const listener of this.turned) listener();
  }

  /** @param {() => void} listener another frame is shown @returns {() => void} ends it */
  onTurn(listener) {
    this.turned.add(listener);
    return () => this.turned.delete(listener);
  }

  dispose() {
    this.live.close();
    setLink(this.link, true);
  }
}
