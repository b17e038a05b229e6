/**
 * Frames of a shot in memory for playback: linear light as RGB9E5 like live tiles, so that exposure and tone curve apply during
 * playback; downscaled if all of them would take too much memory.
 */

import { fetchWords } from "../news/api.js";
import { Film } from "../film/film.js";

/** @typedef {import("./shot-frames.js").ShotFrames} ShotFrames */

const AT_A_TIME = 3;
/** Maximum width for playback; larger frames would take longer to fetch than to render. */
const WIDEST = 960;
const NARROWEST = 160;
/** Minimum width that the service accepts. */
const LEAST_ASKED = 16;
/** Factor of samples after which a growing frame is fetched again. */
const WORTH = 1.5;
const RENEW_MS = 2000;
const RETRY_MS = 5000;

/** Memory limit for frames in bytes: an eighth of the device's memory. */
function memoryBound() {
  const gigabytes = /** @type {{deviceMemory?: number}} */ (navigator).deviceMemory ?? 4;
  return Math.min(gigabytes, 4) * 2 ** 27;
}

/**
 * Returns the width to request and the resulting size. Pictures are downscaled by square blocks of pixels
 * (service/watching/downscale.py).
 *
 * @param {{width: number, height: number}} size
 * @param {number} count of frames
 * @param {number} bound bytes
 * @returns {{wanted: number, width: number, height: number, fits: number}} fits: so many of them
 */
export function planOf({ width, height }, count, bound) {
  const most = Math.sqrt((bound / 4 / Math.max(count, 1)) * (width / height));
  const widest = Math.max(NARROWEST, Math.min(WIDEST, most));
  const wanted = Math.min(width, Math.max(LEAST_ASKED, Math.floor(width / Math.ceil(width / widest))));
  const side = Math.max(1, Math.min(Math.floor(width / wanted), height));
  const small = { width: Math.floor(width / side), height: Math.floor(height / side) };
  return { wanted, ...small, fits: Math.floor(bound / (4 * small.width * small.height)) };
}

export class FrameMemory {
  /**
   * @param {string} job
   * @param {{width: number, height: number}} size of the film
   * @param {ShotFrames} frames
   * @param {() => void} changed more of them are here
   */
  constructor(job, size, frames, changed) {
    this.job = job;
    this.size = size;
    this.frames = frames;
    this.changed = changed;
    /** @type {Map<number, {film: Film, samples: number, at: number}>} */
    this.held = new Map();
    /** @type {Map<number, AbortController>} */
    this.fetching = new Map();
    /** Times of failed fetches, by frame. @type {Map<number, number>} */
    this.refused = new Map();
    this.plan = planOf(size, 1, memoryBound());
    /** Whether to fetch frames; true from the first playback on. */
    this.wanted = false;
  }

  /** @param {number} number @returns {Film | null} */
  film(number) {
    return this.held.get(number)?.film ?? null;
  }

  /** Number of loaded frames in the played range, and their maximum. */
  loaded() {
    const [from, to] = this.frames.part;
    let here = 0;
    for (const number of this.frames.numbers.value.slice(from, to + 1)) here += this.held.has(number) ? 1 : 0;
    return { here, of: to - from + 1 };
  }

  bytes() {
    return this.held.size * 4 * this.plan.width * this.plan.height;
  }

  /** Updates the plan after a change of the played range. */
  replan() {
    const [from, to] = this.frames.part;
    const plan = planOf(this.size, to - from + 1, memoryBound());
    if (plan.width === this.plan.width && plan.height === this.plan.height) {
      this.plan = plan;
      return;
    }
    this.plan = plan;
    this.clear();
  }

  clear() {
    for (const controller of this.fetching.values()) controller.abort();
    this.fetching.clear();
    this.held.clear();
    this.refused.clear();
    this.changed();
  }

  /** Fetches the next frames, starting at the current one. */
  fill() {
    while (this.wanted && this.fetching.size < AT_A_TIME) {
      const next = this.next();
      if (next === null) return;
      void this.fetch(next);
    }
  }

  /** @returns {number | null} */
  next() {
    const [from, to] = this.frames.part;
    const { at } = this.frames;
    const { value } = this.frames.numbers;
    const now = performance.now();
    const start = at < from || at > to ? from : at;
    /** @type {number | null} */
    let old = null;
    for (let i = 0; i <= to - from; i++) {
      const number = value[from + ((start - from + i) % (to - from + 1))] ?? 0;
      const samples = this.frames.known.get(number)?.samples ?? 0;
      if (!samples || this.fetching.has(number) || now - (this.refused.get(number) ?? -Infinity) < RETRY_MS) continue;
      const held = this.held.get(number);
      if (!held) return i < this.plan.fits ? number : old;
      const finished = this.frames.known.get(number)?.state === "finished";
      const grown = samples >= held.samples * WORTH || (finished && samples > held.samples);
      if (old === null && (grown || samples < held.samples) && now - held.at > RENEW_MS) old = number;
    }
    return old;
  }

  /** @param {number} number */
  async fetch(number) {
    const controller = new AbortController();
    this.fetching.set(number, controller);
    const { wanted, width, height, fits } = this.plan;
    try {
      /** @type {Record<string, number>} */
      const query = wanted < this.size.width ? { width: wanted } : {};
      const { words, samples } = await fetchWords({ job: this.job, frame: number }, query, controller.signal);
      if (controller.signal.aborted) return;
      if (this.held.size >= fits && !this.held.has(number)) this.drop();
      this.held.set(number, { film: new Film(width, height, words), samples, at: performance.now() });
    } catch {
      // No samples yet, or the connection is lost, as the banner shows: retried later.
      if (!controller.signal.aborted) this.refused.set(number, performance.now());
    } finally {
      if (this.fetching.get(number) === controller) {
        this.fetching.delete(number);
        this.changed();
        this.fill();
      }
    }
  }

  /** Evicts the frame farthest from the current one. */
  drop() {
    const { value } = this.frames.current;
    let far = -1;
    for (const number of this.held.keys()) if (far < 0 || Math.abs(number - value) > Math.abs(far - value)) far = number;
    this.held.delete(far);
  }

  dispose() {
    this.wanted = false;
    this.changed = () => {};
    this.clear();
  }
}
