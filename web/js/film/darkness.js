/**
 * Detects pictures that look black on a screen although they have light, by the same rule as
 * renderer/image/darkness.py.
 */

/** @typedef {import("./film.js").Film} Film */

/** Fraction of white below which a picture looks black. */
const DARK = 0.01;

/** Stops of exposure that make a picture's brightest parts white, from which it is dim: a sun near the horizon, a weak lamp. */
const DIM_STOPS = 1.5;

/**
 * Returns the stops that would make a dim picture as bright as the screen can show; null if it is bright enough with its exposure, or black.
 *
 * @param {Pick<Film, "normalisingExposure">} film
 * @param {number} exposure in stops, with which it is shown
 * @returns {number | null}
 */
export function dimness(film, exposure) {
  const stops = film.normalisingExposure();
  return stops === null || stops - exposure < DIM_STOPS ? null : Math.floor(2 * stops) / 2;
}

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
