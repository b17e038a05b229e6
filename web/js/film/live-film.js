/** The growing film of one job: fetched whole, then updated over its live connection. Notifies listeners of new samples. */

import { ApiError, fetchFilm } from "../news/api.js";
import { putJob, setLink } from "../news/farm.js";
import { Film } from "./film.js";
import { takeFirstLook } from "./first-look.js";
import { Live } from "../news/live.js";
import { firstFrame } from "../base/shot-words.js";
import { showError } from "../shell/tray.js";
import { Store } from "../base/store.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../news/tile-packet.js").TilePacket} TilePacket */

/** Delay before a frame's whole film is fetched, so that stepping through frames fetches only the last. */
const REST_MS = 200;

/** @param {Pick<Job, "state">} job */
const isRendering = ({ state }) => state === "queued" || state === "running";

export class LiveFilm {
  /** @param {Job} job of known size @param {number} [frame] @param {Promise<unknown>} [after] what the fetch of the whole film waits for */
  constructor(job, frame = firstFrame(job), after = Promise.resolve()) {
    this.after = after;
    this.job = job.id;
    /** Whether its background is transparent, so that it has an alpha plane. */
    this.isTransparent = job.settings?.background === "transparent";
    /** Current frame; changed by `turnTo`. */
    this.frame = frame;
    /** Whether no more samples will arrive. */
    this.finished = job.state === "finished";
    /** Whether samples are arriving, or will. */
    this.isRendering = isRendering(job);
    this.film = new Film(job.width ?? 1, job.height ?? 1);
    this.side = job.tile_size ?? 0;
    /** Whether the fetch of the film has ended; afterwards the page sends the service its sample counts. */
    this.isFetched = false;
    this.fetching = new AbortController();
    /** @type {Set<() => void>} */
    this.filled = new Set();
    this.turnedAt = -Infinity;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.resting = undefined;
    /** @type {Set<(tile: TilePacket) => void>} */
    this.listeners = new Set();
    /** @type {Set<() => void>} */
    this.turned = new Set();
    /** Called with the changed frames of a shot. @type {(frames: import("../base/types.js").Frame[]) => void} */
    this.framesChanged = () => {};
    /** The reason why the frame's film is lost; empty if it is not lost. @type {Store<string>} */
    this.missing = new Store("");
    this.link = `live ${job.id}`;
    this.live = new Live(job.id, frame, {
      tile: (tile) => {
        if (tile.frame !== Math.floor(this.frame) % 65536) return; // of the previous frame
        this.missing.set("");
        this.film.put(tile);
        for (const listener of this.listeners) listener(tile);
      },
      message: (message) => {
        if (message.type === "frames") this.framesChanged(message.frames);
        if (message.type !== "state") return;
        this.finished = message.job.state === "finished";
        this.isRendering = isRendering(message.job);
        if (["queued", "running"].includes(message.job.state)) this.missing.set(""); // it is being rendered again
        putJob(message.job);
      },
      link: (up) => setLink(this.link, up),
      have: () => (this.isFetched ? (this.side ? this.film.tileSamples(this.side) : []) : null),
      refused: (sentence) =>
        showError(t("The live picture ended"), sentence, {
          ofPage: true,
          action: { label: t("Reload the page"), run: () => location.reload() },
        }),
    });
    const hasSamples = job.samples > 0 || job.state === "finished";
    const first = takeFirstLook(job.id);
    /** The live view's last picture, of the same view: null if the job was not started from it. @type {Film | null} */
    this.look = first?.isSame && !first.clean ? first.film : null;
    /** Whether `look` is the picture of an earlier job. */
    this.isAgain = this.look !== null && first?.isPrevious === true;
    /** URL of a picture without noise that is shown until the job's own is denoised; "": none. */
    this.clean = (job.denoise && first?.clean) || "";
    /** Samples per pixel of a denoised picture that looks as good as `look` or `clean`; 0: neither is there, or it is of another camera or light. */
    this.worth = first?.worth ?? 0;
    /** Whether the service had a denoised picture of the frame when the page was opened. */
    this.isDenoisedStored = frame === firstFrame(job) && job.frames?.[0]?.denoised === true;
    /** Where the page before had the picture; null: nowhere. @type {DOMRect | null} */
    this.place = first?.place ?? null;
    /** Whether a poster is shown until the film is here. */
    this.hasPoster = hasSamples || this.clean !== "";
    if (first && !this.clean && !first.film.isBlank) this.film.restart(first.film); // tiles of another view replace it one by one
    else this.film.isPartial = hasSamples;
    void this.fetch(hasSamples);
  }

  /** Fetches the whole film; if that fails, tiles arrive individually. @param {boolean} hasSamples whether there is anything */
  async fetch(hasSamples) {
    this.fetching.abort();
    const { signal } = (this.fetching = new AbortController());
    try {
      if (hasSamples) await this.after;
      if (signal.aborted) return;
      const packet = hasSamples ? await fetchFilm(this, signal) : null;
      if (signal.aborted) return;
      if (packet) {
        this.side = packet.side;
        this.film.take(packet);
        this.film.isPartial = false;
        for (const listener of this.filled) listener();
      }
      this.missing.set("");
    } catch (error) {
      if (signal.aborted) return;
      this.missing.set(error instanceof ApiError && error.status === 409 ? error.message : "");
    }
    this.isFetched = true;
    this.film.isPartial = false;
    this.live.sendHave();
  }

  /** @param {() => void} listener all of the film may have changed @returns {() => void} ends it */
  onFill(listener) {
    this.filled.add(listener);
    return () => this.filled.delete(listener);
  }

  /** @param {(tile: TilePacket) => void} listener @returns {() => void} ends it */
  onTile(listener) {
    this.listeners.add(listener);
    return () => this.listeners.delete(listener);
  }

  /**
   * Switches to another frame of the shot.
   *
   * @param {number} frame
   * @param {Film | null} meanwhile the picture to show until the frame's tiles have arrived
   */
  turnTo(frame, meanwhile) {
    this.frame = frame;
    this.film.restart(meanwhile);
    this.missing.set("");
    this.isFetched = false;
    this.fetching.abort();
    this.live.turnTo(frame);
    const now = performance.now();
    clearTimeout(this.resting);
    this.resting = setTimeout(() => void this.fetch(true), now - this.turnedAt < REST_MS ? REST_MS : 0);
    this.turnedAt = now;
    for (const listener of this.turned) listener();
  }

  /** @param {() => void} listener another frame is shown @returns {() => void} ends it */
  onTurn(listener) {
    this.turned.add(listener);
    return () => this.turned.delete(listener);
  }

  dispose() {
    clearTimeout(this.resting);
    this.fetching.abort();
    this.live.close();
    setLink(this.link, true);
  }
}
