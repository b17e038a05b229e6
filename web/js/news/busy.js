/** Requests that the service turns away for a moment (503 with Retry-After). They are made again, and the page says when. */

import { Store } from "../base/store.js";

const TRIES = 8;
const LONGEST_S = 60;

/** When each request that waits is made again, by performance.now(). @type {Store<readonly number[]>} */
export const retries = new Store(/** @type {readonly number[]} */ ([]));

/**
 * As fetch. Where the service is busy, the request is repeated after the time that it names; its last answer is returned.
 *
 * @param {string} url
 * @param {AbortSignal} signal
 * @returns {Promise<Response>}
 */
export async function fetchPatiently(url, signal) {
  for (let tries = 1; ; tries += 1) {
    const response = await fetch(url, { signal });
    const seconds = Number(response.headers.get("Retry-After"));
    if (response.status !== 503 || !(seconds > 0) || tries === TRIES) return response;
    await response.body?.cancel();
    await pause(1000 * Math.min(seconds, LONGEST_S) * (1 + 0.25 * Math.random()), signal);
  }
}

/** @param {number} ms @param {AbortSignal} signal */
async function pause(ms, signal) {
  const at = performance.now() + ms;
  retries.update((others) => [...others, at]);
  try {
    await /** @type {Promise<void>} */ (
      new Promise((resolve, reject) => {
        const timer = setTimeout(resolve, ms);
        signal.addEventListener("abort", () => (clearTimeout(timer), reject(signal.reason)), { once: true });
      })
    );
  } finally {
    retries.update((all) => all.toSpliced(all.indexOf(at), 1));
  }
}

/** Pictures in lists: a browser does not tell why one did not come. */
const IMAGE_TRIES = 4;
const FIRST_IMAGE_MS = 2000;

/**
 * Shows a picture; one that does not come is asked for again, at growing intervals.
 *
 * @param {HTMLImageElement} image
 * @param {string} url
 */
export function showImage(image, url) {
  let tries = 0;
  image.onerror = () => {
    tries += 1;
    const again = () => image.isConnected && image.getAttribute("src") === url && (image.src = url);
    if (tries < IMAGE_TRIES) setTimeout(again, FIRST_IMAGE_MS * 2 ** (tries - 1) * (1 + 0.5 * Math.random()));
  };
  image.src = url;
}
