/** Brightness statistics of a rectangle of a film: the mean light, and the range of the pixels' luminances. */

import { luminanceOf } from "../base/colour.js";
import { decode } from "./rgb9e5.js";

/** @typedef {import("./film.js").Film} Film */
/** @typedef {import("./region.js").Rect} Rect */

/**
 * @typedef {object} Area
 * @property {[number, number, number]} rgb the mean, linear Rec.709
 * @property {number} luminance of the mean
 * @property {number} least luminance of a pixel
 * @property {number} most luminance of a pixel
 * @property {number} spread standard deviation of the pixels' luminances
 * @property {number} pixels that have samples; 0: all else is 0 too
 */

/**
 * @param {Film} film
 * @param {Rect} rect what lies beside the film is left out
 * @returns {Area}
 */
export function areaOf(film, { x, y, w, h }) {
  const [right, bottom] = [Math.min(x + w, film.width), Math.min(y + h, film.height)];
  /** @type {[number, number, number]} */
  const rgb = [0, 0, 0];
  let [pixels, least, most, mean, squares] = [0, Infinity, 0, 0, 0];
  for (let row = Math.max(0, y); row < bottom; row++) {
    for (let i = row * film.width + Math.max(0, x); i < row * film.width + right; i++) {
      if (!film.samples[i]) continue;
      const light = decode(film.words[i] ?? 0);
      const luminance = luminanceOf(light);
      pixels++;
      light.forEach((value, c) => (rgb[c] = (rgb[c] ?? 0) + value));
      least = Math.min(least, luminance);
      most = Math.max(most, luminance);
      // Welford 1962, "Note on a method for calculating corrected sums of squares and products"
      const off = luminance - mean;
      mean += off / pixels;
      squares += off * (luminance - mean);
    }
  }
  if (!pixels) return { rgb, luminance: 0, least: 0, most: 0, spread: 0, pixels };
  return {
    rgb: [rgb[0] / pixels, rgb[1] / pixels, rgb[2] / pixels],
    luminance: mean,
    least,
    most,
    spread: Math.sqrt(squares / pixels),
    pixels,
  };
}
