/** Delays between retries: doubled each time up to a limit, with jitter so that pages do not retry at the same moment. */

const FIRST_MS = 400;
const LONGEST_MS = 8000;

export class Backoff {
  constructor() {
    this.failures = 0;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    /** @type {(() => void) | null} */
    this.waiting = null;
    this.online = () => this.now();
  }

  /** @param {() => void} attempt */
  schedule(attempt) {
    const wait = Math.min(LONGEST_MS, FIRST_MS * 2 ** this.failures) * (0.75 + 0.5 * Math.random());
    this.failures += 1;
    this.waiting = attempt;
    addEventListener("online", this.online);
    clearTimeout(this.timer);
    this.timer = setTimeout(() => this.now(), wait);
  }

  /** Runs a scheduled attempt at once. */
  now() {
    const attempt = this.waiting;
    this.cancel();
    attempt?.();
  }

  succeeded() {
    this.failures = 0;
  }

  cancel() {
    clearTimeout(this.timer);
    removeEventListener("online", this.online);
    this.waiting = null;
  }
}
