/**
 * Detects pictures that look black on a screen although they have light, by the same rule as renderer/image/darkness.py, and
 * chooses the exposure of a picture whose light has changed.
 */

/** @typedef {ReturnType<import("./film.js").Film["brightness"]>} Brightness */

/** Fraction of white below which a picture looks black. */
const DARK = 0.01;
/** Mean luminance of a well exposed picture, that of a grey card; and how many stops brighter than normalised such a picture may be. */
const [GREY, OVER] = [0.18, 1.5];

/**
 * Returns how dark a film is: its brightest radiance, and the stops that make this white; null if it is bright enough, or black.
 *
 * @param {Brightness} film
 * @returns {{brightest: number, exposure: number} | null}
 */
export function darkness({ white }) {
  if (white <= 0 || white >= DARK) return null;
  return { brightest: white, exposure: Math.floor(-2 * Math.log2(white)) / 2 };
}

/**
 * Returns the stops that make a dark or dull film well exposed: its bright surfaces white, and a mean that is still dark brighter.
 * Quarters of stops; 0 for a film that is bright enough, or black.
 *
 * @param {Brightness} film
 * @returns {number}
 */
export function autoExposure({ white, bright, mean }) {
  if (white <= 0) return 0;
  const wanted = Math.max(Math.log2(GREY / mean), bright > 0 ? -Math.log2(bright) : 0);
  return Math.max(0, Math.round(4 * Math.min(wanted, OVER - Math.log2(white))) / 4);
}
