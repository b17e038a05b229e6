/**
 * Pictures of cards and rows that the page has shown: a card that is created again shows its picture in its first frame, without
 * loading and decoding it, and a job's page begins with the picture of its row.
 */

/** Number of pictures that are kept. */
const MOST = 48;

/** By a picture's URL or `jobRowOf`, the latest ones last. @type {Map<string, HTMLImageElement>} */
const shown = new Map();

/** Returns the name of the picture of a job's row, whose URL changes with its samples. @param {string} job its id */
export const jobRowOf = (job) => `job ${job}`;

/** Returns the element of a picture that was shown before and is on no page now; null: there is none. @param {string} name */
export function shownImage(name) {
  const image = shown.get(name);
  return image && !image.isConnected ? image : null;
}

/** Returns the URL of a picture that was shown, which the browser has; "" if there is none. @param {string} name */
export function shownUrl(name) {
  const src = shown.get(name)?.src ?? "";
  return src.startsWith("blob:") ? "" : src; // its data are freed
}

/** Keeps the element of a picture. @param {string} name @param {HTMLImageElement} image loaded */
export function keepShownImage(name, image) {
  shown.delete(name);
  shown.set(name, image);
  for (const [oldest] of shown) {
    if (shown.size <= MOST) break;
    shown.delete(oldest);
  }
}
