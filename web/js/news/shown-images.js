/**
 * Pictures of cards as the page has shown them: a card that is made again shows its picture in its first frame, without loading and
 * decoding it.
 */

/** Number of pictures that are kept. */
const MOST = 48;

/** The latest ones last. @type {Map<string, HTMLImageElement>} */
const shown = new Map();

/** Returns the element of a picture that was shown before and is on no page now; null: there is none. @param {string} url */
export function shownImage(url) {
  const image = shown.get(url);
  return image && !image.isConnected ? image : null;
}

/** Keeps the element of a picture. @param {string} url @param {HTMLImageElement} image loaded */
export function keepShownImage(url, image) {
  shown.delete(url);
  shown.set(url, image);
  for (const [oldest] of shown) {
    if (shown.size <= MOST) break;
    shown.delete(oldest);
  }
}
