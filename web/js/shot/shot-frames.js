/** The frames of a shot as the page knows them, which of them is looked at, and the part between the in and the out point. */

import { Store } from "../base/store.js";
import { parseFrames } from "../base/frame-numbers.js";

/** @typedef {import("../base/types.js").Frame} Frame */
/** @typedef {import("../base/types.js").Job} Job */

export class ShotFrames {
  /** @param {Job} job a shot @param {number | null} [current] */
  constructor(job, current = null) {
    this.text = "";
    /** In their order. @type {Store<number[]>} */
    this.numbers = new Store(/** @type {number[]} */ ([]));
    /** @type {Map<number, Frame>} */
    this.known = new Map();
    /** Those that changed last. @type {Store<Frame[]>} */
    this.news = new Store(/** @type {Frame[]} */ ([]));
    this.update(job);
    const { value } = this.numbers;
    this.current = new Store(current !== null && value.includes(current) ? current : (value[0] ?? 0));
    /** First and last frame of the part that is played, by their places; null: all. @type {Store<[number, number] | null>} */
    this.range = new Store(/** @type {[number, number] | null} */ (null));
  }

  /** The shot may have been extended. @param {Job} job */
  update({ shot }) {
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

  /** The frame that is looked at, as far as it is known. */
  get frame() {
    return this.known.get(this.current.value) ?? null;
  }

  /** The place of the frame that is looked at. */
  get at() {
    return Math.max(0, this.numbers.value.indexOf(this.current.value));
  }

  /** @param {number} place held between the first and the last */
  go(place) {
    const { value } = this.numbers;
    const number = value[Math.min(Math.max(place, 0), value.length - 1)];
    if (number !== undefined && number !== this.current.value) this.current.set(number);
  }

  /** First and last place of what is played. @returns {[number, number]} */
  get part() {
    const last = this.numbers.value.length - 1;
    const [from, to] = this.range.value ?? [0, last];
    return [Math.min(from, last), Math.min(to, last)];
  }

  /** Goes to a place, and takes all that lies between into the part; what is at its other end stays. @param {number} place */
  stretch(place) {
    const { at } = this;
    const [from, to] = this.range.value ?? [at, at];
    const fixed = at === from ? to : at === to ? from : at;
    const next = Math.min(Math.max(place, 0), this.numbers.value.length - 1);
    this.range.set([Math.min(fixed, next), Math.max(fixed, next)]);
    this.go(next);
  }

  /** The part begins, or ends, here. @param {"in" | "out"} end */
  mark(end) {
    const { at } = this;
    const [from, to] = this.part;
    this.range.set(end === "in" ? [at, Math.max(at, to)] : [Math.min(at, from), at]);
  }
}
