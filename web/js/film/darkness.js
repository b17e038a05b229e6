/**
 * Detects pictures that look black on a screen although they have light, by the same rule as
 * renderer/image/darkness.py.
 */

/** @typedef {import("./film.js").Film} Film */

/** Fraction of white below which a picture looks black. */
const DARK = 0.01;

/**
 * Returns how dark a film is: its brightest radiance, and the stops that make this white; null if it is bright enough, or black.
 *
 * @param {Pick<Film, "normalisingExposure">} film
 * @returns {{brightest: number, exposure: number} | null}
 */
export function darkness(film) {
  const exposure = film.normalisingExposure();
  if (exposure === null || 2 ** -exposure >= DARK) return null;
  return { brightest: 2 ** -exposure, exposure: Math.floor(2 * exposure) / 2 };
}
