/** Plays a shot from memory at its frame rate; late frames are skipped. */

import { Store } from "../base/store.js";

/** @typedef {import("./shot-frames.js").ShotFrames} ShotFrames */
/** @typedef {import("./frame-memory.js").FrameMemory} FrameMemory */

export class Player {
  /**
   * @param {ShotFrames} frames
   * @param {FrameMemory} memory
   * @param {() => number} fps
   */
  constructor(frames, memory, fps) {
    this.frames = frames;
    this.memory = memory;
    this.fps = fps;
    this.playing = new Store(false);
    this.loop = new Store(true);
    this.pending = 0;
    /** Time at which the frame at `from` was due. */
    this.begun = 0;
    this.from = 0;
  }

  toggle() {
    if (this.playing.value) this.pause();
    else this.play();
  }

  play() {
    const [first, last] = this.frames.part;
    const { at } = this.frames;
    if (first === last || this.playing.value) return;
    this.frames.go(at < first || at >= last ? first : at);
    this.playing.set(true);
    this.restart();
    this.memory.wanted = true;
    this.memory.fill();
    this.pending = requestAnimationFrame((now) => this.tick(now));
  }

  /** Restarts the clock at the current frame. */
  restart() {
    this.begun = performance.now();
    this.from = this.frames.at;
  }

  pause() {
    cancelAnimationFrame(this.pending);
    if (this.playing.value) this.playing.set(false);
  }

  /** @param {number} now ms */
  tick(now) {
    const [first, last] = this.frames.part;
    if (this.frames.at < first || this.frames.at > last) {
      this.frames.go(first); // the range was changed meanwhile
      this.restart();
    }
    if (!this.memory.loaded().here) this.restart(); // starts at the first loaded frame
    let place = this.from + Math.max(0, Math.floor(((now - this.begun) / 1000) * this.fps() + 1e-6));
    if (place > last) {
      if (!this.loop.value) {
        this.frames.go(last);
        this.pause();
        return;
      }
      const length = last - first + 1;
      this.begun += ((length - ((this.from - first) % length)) / this.fps()) * 1000;
      this.from = first;
      place = first + ((place - first) % length);
      while (now - this.begun >= (length / this.fps()) * 1000) this.begun += (length / this.fps()) * 1000;
    }
    if (place !== this.frames.at) this.frames.go(place);
    this.pending = requestAnimationFrame((next) => this.tick(next));
  }
}
