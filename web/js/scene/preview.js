/**
 * A small, quick picture of a view that keeps changing: a job of a few samples at the highest priority, taken back as soon
 * as another view is wanted. At most one is there at any time.
 */

import { createJob, deleteJob } from "../news/api.js";
import { setHidden } from "../news/farm.js";
import { PREVIEW_NAME } from "../news/passing.js";
import { Film } from "../film/film.js";
import { LiveFilm } from "../film/live-film.js";
import { parseFrames } from "../base/frame-numbers.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").JobRequest} JobRequest */

const PRIORITY = 100;
const LONG_SIDE = 320;
const SPP = 32;
const DEPTH = 4;

export class Preview {
  /**
   * @param {number} aspect width / height
   * @param {{shown: (film: Film) => void, failed: (error: unknown) => void}} handlers shown: new samples are in the film
   */
  constructor(aspect, handlers) {
    this.handlers = handlers;
    this.size =
      aspect >= 1
        ? { width: LONG_SIDE, height: Math.max(1, Math.round(LONG_SIDE / aspect)) }
        : { width: Math.max(1, Math.round(LONG_SIDE * aspect)), height: LONG_SIDE };
    this.film = new Film(this.size.width, this.size.height);
    /** What is being rendered, or was last. @type {{job: string, live: LiveFilm, whole: boolean} | null} */
    this.current = null;
    /** What is to be rendered next. @type {JobRequest | null} */
    this.wanted = null;
    this.asking = false;
    this.closed = false;
    this.leave = () => this.dispose();
    addEventListener("pagehide", this.leave);
  }

  /** The picture that is shown, where all of it is there. */
  get place() {
    return this.current?.whole ? this.current.live : null;
  }

  /** @param {JobRequest} request whose view is wanted now */
  show(request) {
    this.wanted = request;
    void this.next();
  }

  /** The next view is asked for when the last one has been seen: else a hand that keeps moving would see none. */
  async next() {
    if (!this.wanted || this.asking || this.closed || (this.current && !this.current.whole)) return;
    const request = this.wanted;
    this.wanted = null;
    this.asking = true;
    this.drop();
    try {
      const depth = Math.min(request.max_depth ?? DEPTH, DEPTH);
      /** @type {JobRequest} */
      const small = { ...request, ...this.size, spp: SPP, max_depth: depth, name: PREVIEW_NAME, priority: PRIORITY };
      if (small.frames) small.frame = firstOf(small.frames);
      for (const name of ["noise", "seconds", "frames", "order", "every"]) delete small[name];
      const job = await createJob(small, `preview-${Date.now()}-${Math.random()}`);
      setHidden(job.id, true);
      if (this.closed) void remove(job.id);
      else this.follow(job);
    } catch (error) {
      if (!this.closed) this.handlers.failed(error);
    } finally {
      this.asking = false;
    }
    void this.next();
  }

  /** @param {Job} job */
  follow(job) {
    const live = new LiveFilm(job);
    /** @type {NonNullable<typeof this.current>} */
    const current = { job: job.id, live, whole: false };
    this.current = current;
    let pixels = 0;
    live.onTile((tile) => {
      this.film.put(tile); // over the last view: better an old picture than a black one
      pixels += tile.w * tile.h;
      current.whole ||= pixels >= this.size.width * this.size.height;
      this.handlers.shown(this.film);
      if (current.whole) void this.next();
    });
  }

  drop() {
    if (!this.current) return;
    this.current.live.dispose();
    void remove(this.current.job);
    this.current = null;
  }

  dispose() {
    removeEventListener("pagehide", this.leave);
    this.closed = true;
    this.drop();
  }
}

/** @param {string} frames of a shot */
function firstOf(frames) {
  const numbers = parseFrames(frames);
  return typeof numbers === "string" ? 0 : (numbers[0] ?? 0);
}

/** @param {string} job */
async function remove(job) {
  try {
    await deleteJob(job);
  } catch {
    // Deleted by somebody else, or the connection is lost (the banner says so).
  }
}
