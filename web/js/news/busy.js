/** Retries of requests that a busy service rejects (503 with Retry-After), and the state that the page shows meanwhile. */

import { Store } from "../base/store.js";

const TRIES = 8;
const LONGEST_S = 60;

/** Times of the pending retries, by performance.now(). @type {Store<readonly number[]>} */
export const retries = new Store(/** @type {readonly number[]} */ ([]));

/**
 * As fetch, but repeats the request after the time that a busy service names; returns the last response.
 *
 * @param {string} url
 * @param {{signal?: AbortSignal, method?: string, isWanted?: () => boolean}} [options] isWanted: checked before each retry
 * @returns {Promise<Response>}
 */
export async function fetchWithRetries(url, { signal, method = "GET", isWanted = () => true } = {}) {
  for (let tries = 1; ; tries += 1) {
    const response = await fetch(url, { method, signal });
    const seconds = Number(response.headers.get("Retry-After"));
    if (response.status !== 503 || !(seconds > 0) || tries === TRIES) return response;
    await pause(1000 * Math.min(seconds, LONGEST_S) * (1 + 0.25 * Math.random()), signal);
    if (!isWanted()) return response;
    await response.body?.cancel();
  }
}

/** @param {number} ms @param {AbortSignal} [signal] */
async function pause(ms, signal) {
  const at = performance.now() + ms;
  retries.update((others) => [...others, at]);
  try {
    await /** @type {Promise<void>} */ (
      new Promise((resolve, reject) => {
        const timer = setTimeout(resolve, ms);
        signal?.addEventListener("abort", () => (clearTimeout(timer), reject(signal.reason)), { once: true });
      })
    );
  } finally {
    retries.update((all) => all.toSpliced(all.indexOf(at), 1));
  }
}
