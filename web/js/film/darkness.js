/**
 * Detects pictures that look black on a screen although they have light, by the same rule as renderer/image/darkness.py, and
 * chooses the exposure of a picture whose light has changed.
 */

/** @typedef {import("./brightness.js").Brightness} Brightness */

/** How dark a film is: its brightest radiance, and the stops that make this white. @typedef {{brightest: number, exposure: number}} Darkness */

/** Fraction of white below which a picture looks black. */
const DARK = 0.01;
/** Key of a well exposed picture, a little above a grey card's. */
const KEY = 0.22;
/** Radiance that the brightest tenth gets at most; and the stops that it must be over that for a picture to be made darker. */
const [HIGH, OVER] = [0.8, 1];

/** Returns how dark a film is; null if it is bright enough, or exactly black (Film.isBlack). @param {Brightness} film @returns {Darkness | null} */
export function darkness({ white }) {
  if (white <= 0 || white >= DARK) return null;
  return { brightest: white, exposure: Math.floor(-2 * Math.log2(white)) / 2 };
}

/**
 * Returns the stops that make a film well exposed: its key KEY, but the brightest tenth at most HIGH, or its lit surfaces white if that
 * takes no more than half a stop beyond the key. Only a picture of which a tenth is far over white is made darker. Quarters of stops;
 * 0 for a film that is well exposed, or black.
 *
 * @param {Brightness} film
 * @returns {number}
 */
export function autoExposure({ bright, high, key }) {
  if (key <= 0) return 0;
  const [wanted, limit] = [Math.log2(KEY / key), Math.log2(HIGH / Math.max(high, Number.MIN_VALUE))];
  if (limit < -OVER) return Math.round(4 * limit) / 4;
  const whitened = Math.min(-Math.log2(Math.max(bright, Number.MIN_VALUE)), wanted + 0.5);
  return Math.max(0, Math.round(4 * Math.max(Math.min(wanted, limit), whitened)) / 4);
}
