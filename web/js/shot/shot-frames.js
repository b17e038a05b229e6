/** The frames of a shot as known to the page, the current one, and the range between the in and out points. */

import { Store } from "../base/store.js";
import { parseFrames } from "../base/frame-numbers.js";

/** @typedef {import("../base/types.js").Frame} Frame */
/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {Omit<Frame, "state"> & {state: Frame["state"] | "paused"}} ShownFrame */

export class ShotFrames {
  /** @param {Job} job a shot @param {number | null} [current] */
  constructor(job, current = null) {
    this.text = "";
    /** Whether the job is paused, and with it the frames that it had begun. */
    this.isPaused = false;
    /** In order. @type {Store<number[]>} */
    this.numbers = new Store(/** @type {number[]} */ ([]));
    /** @type {Map<number, Frame>} */
    this.known = new Map();
    /** The frames that changed last. @type {Store<Frame[]>} */
    this.news = new Store(/** @type {Frame[]} */ ([]));
    this.update(job);
    const { value } = this.numbers;
    this.current = new Store(current !== null && value.includes(current) ? current : (value[0] ?? 0));
    /** First and last index of the played range; null: all. @type {Store<[number, number] | null>} */
    this.range = new Store(/** @type {[number, number] | null} */ (null));
  }

  /** Updates the list after the shot was extended, and the frames' states after it was paused or resumed. @param {Job} job */
  update({ shot, state }) {
    const isPaused = state === "paused";
    if (isPaused !== this.isPaused) {
      this.isPaused = isPaused;
      this.news.set([]);
    }
    if (!shot || shot.frames === this.text) return;
    this.text = shot.frames;
    const numbers = parseFrames(shot.frames);
    if (typeof numbers !== "string") this.numbers.set(numbers.sort((a, b) => a - b));
  }

  /** @param {Frame[]} frames that have changed */
  take(frames) {
    for (const frame of frames) this.known.set(frame.number, frame);
    this.news.set(frames);
  }

  /** The current frame as it is shown, if it is known. */
  get frame() {
    return this.shown(this.current.value) ?? null;
  }

  /**
   * A frame as it is shown: one that was begun is paused while its job is.
   *
   * @param {number} number
   * @returns {ShownFrame | undefined}
   */
  shown(number) {
    const frame = this.known.get(number);
    const isBegun = frame?.state === "running" || frame?.state === "preparing";
    return frame && this.isPaused && isBegun ? { ...frame, state: "paused" } : frame;
  }

  /** The index of the current frame. */
  get at() {
    return Math.max(0, this.numbers.value.indexOf(this.current.value));
  }

  /** @param {number} place held between the first and the last */
  go(place) {
    const { value } = this.numbers;
    const number = value[Math.min(Math.max(place, 0), value.length - 1)];
    if (number !== undefined && number !== this.current.value) this.current.set(number);
  }

  /** First and last index of the played range. @returns {[number, number]} */
  get part() {
    const last = this.numbers.value.length - 1;
    const [from, to] = this.range.value ?? [0, last];
    return [Math.min(from, last), Math.min(to, last)];
  }

  /** Goes to a frame and extends the range to it; the other end stays. @param {number} place */
  stretch(place) {
    const { at } = this;
    const [from, to] = this.range.value ?? [at, at];
    const fixed = at === from ? to : at === to ? from : at;
    const next = Math.min(Math.max(place, 0), this.numbers.value.length - 1);
    this.range.set([Math.min(fixed, next), Math.max(fixed, next)]);
    this.go(next);
  }

  /** Sets the in or out point at the current frame. @param {"in" | "out"} end */
  mark(end) {
    const { at } = this;
    const [from, to] = this.part;
    this.range.set(end === "in" ? [at, Math.max(at, to)] : [Math.min(at, from), at]);
  }
}
