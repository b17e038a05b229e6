/** Speed and remaining time of an upload. */

/** Window of the average speed: short interruptions do not show, lasting changes do. */
const WINDOW_MS = 8000;
/** Minimum time for a meaningful speed. */
const FIRST_MS = 1500;

export class Pace {
  /** @param {number} total bytes */
  constructor(total) {
    this.total = total;
    /** Bytes sent, with times. @type {{sent: number, at: number}[]} */
    this.seen = [];
  }

  /**
   * @param {number} sent bytes so far
   * @param {number} at milliseconds of any clock
   */
  put(sent, at) {
    this.seen.push({ sent, at });
    while (this.seen.length > 2 && (this.seen[1]?.at ?? at) <= at - WINDOW_MS) this.seen.shift();
  }

  /** @returns {{speed: number, left: number} | null} bytes a second, and seconds; null: not known yet */
  get now() {
    const [first, last] = [this.seen[0], this.seen.at(-1)];
    if (!first || !last || last.at - first.at < FIRST_MS || last.sent <= first.sent) return null;
    const speed = (1000 * (last.sent - first.sent)) / (last.at - first.at);
    return { speed, left: (this.total - last.sent) / speed };
  }
}
