/** Pictures and files of the service. Requests to a busy service are retried, and a refusal becomes the service's message. */

import { ApiError, errorOf } from "./api.js";
import { fetchWithRetries } from "./busy.js";
import { t } from "../base/words.js";

/** The URL that each element should show. @type {WeakMap<HTMLImageElement, string>} */
const wanted = new WeakMap();

/**
 * Shows a picture. `<img>` does not report the reason of a failure, so the picture is then fetched: a busy service is requested
 * again after the time that it names.
 *
 * @param {HTMLImageElement} image
 * @param {string} url
 * @returns {Promise<void>} rejects with an ApiError where the service refuses; resolves also where another picture is wanted meanwhile
 */
export async function showImage(image, url) {
  wanted.set(image, url);
  const isWanted = () => wanted.get(image) === url;
  if ((await shows(image, url)) || !isWanted()) return;
  try {
    const response = await fetchOrThrow(url, { isWanted: () => isWanted() && image.isConnected });
    const local = URL.createObjectURL(await response.blob());
    try {
      if (isWanted() && !(await shows(image, local)) && isWanted()) throw new ApiError(response.status, t("The browser cannot show this picture."));
    } finally {
      URL.revokeObjectURL(local);
    }
  } catch (error) {
    if (isWanted()) throw error;
  }
}

/** Cancels the picture of an element. @param {HTMLImageElement} image */
export function forgetImage(image) {
  wanted.delete(image);
  image.removeAttribute("src"); // cancels loading
}

/** @param {HTMLImageElement} image @param {string} src @returns {Promise<boolean>} whether it was loaded */
function shows(image, src) {
  return new Promise((resolve) => {
    const end = new AbortController();
    for (const type of ["load", "error"]) {
      image.addEventListener(type, () => (end.abort(), resolve(type === "load")), { signal: end.signal });
    }
    image.src = src;
  });
}

/** Fetches a file of the service. Rejects with an ApiError. @param {string} url @returns {Promise<Blob>} */
export const fetchFile = async (url) => (await fetchOrThrow(url)).blob();

/** @param {string} url @returns {Promise<void>} rejects with an ApiError where the service would refuse the file */
export async function askFor(url) {
  const { status } = await fetchWithRetries(url, { method: "HEAD" }).catch(() => Promise.reject(errorOf(0, "")));
  if (status >= 400) await fetchOrThrow(url); // a response to HEAD has no message
}

/** @param {string} url @param {{isWanted?: () => boolean, signal?: AbortSignal}} [options] @returns {Promise<Response>} rejects with an ApiError */
async function fetchOrThrow(url, options) {
  const response = await fetchWithRetries(url, options).catch(() => Promise.reject(errorOf(0, "")));
  if (!response.ok) throw errorOf(response.status, await response.text());
  return response;
}

/**
 * Saves a file of the service like a link with `download`, except that a refusal throws an error instead of appearing in the
 * browser's list of downloads.
 *
 * @param {string} url
 * @param {AbortSignal} [signal] after which it is not saved
 * @returns {Promise<string>} the file's name
 */
export async function saveFile(url, signal) {
  const response = await fetchOrThrow(url, { signal });
  const local = URL.createObjectURL(await response.blob());
  const anchor = document.createElement("a");
  anchor.href = local;
  anchor.download = fileName(response.headers.get("Content-Disposition") ?? "", url);
  anchor.click();
  setTimeout(() => URL.revokeObjectURL(local), 60_000); // the browser may ask where to save it first
  return anchor.download;
}

/** @param {string} disposition @param {string} url */
export function fileName(disposition, url) {
  const [, encoded] = /filename\*=UTF-8''([^;]+)/i.exec(disposition) ?? [];
  const [, plain] = /filename="((?:[^"\\]|\\.)*)"/i.exec(disposition) ?? [];
  if (encoded) return decodeURIComponent(encoded);
  return plain?.replace(/\\(.)/g, "$1") ?? url.split("?")[0]?.split("/").pop() ?? "";
}
