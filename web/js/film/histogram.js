/** Histogram of a film's pixels in bins of a quarter stop, for each channel and the luminance. */

import { luminanceOf } from "../base/colour.js";
import { decode } from "./rgb9e5.js";

/** @typedef {import("./film.js").Film} Film */
/** @typedef {import("./region.js").Rect} Rect */

/** Lowest bin in stops relative to 1, the display's white. */
export const LOWEST = -12;
export const HIGHEST = 6;
const BINS = (HIGHEST - LOWEST) * 4;
/** Approximate number of pixels used: enough for a curve, and fast. */
const MOST_PIXELS = 200_000;

/**
 * @typedef {object} Histogram
 * @property {Float64Array[]} channels R, G, B and luminance: fractions of the pixels with samples
 * @property {number} black share of the pixels whose luminance is below all bins
 * @property {number} above share of the pixels with a channel above 1
 * @property {number} pixels examined
 */

/**
 * @param {Film} film
 * @param {number} exposure stops
 * @param {Rect} [part] within the film; all of it where left out
 * @returns {Histogram}
 */
export function histogramOf(film, exposure, { x, y, w, h } = { x: 0, y: 0, w: film.width, h: film.height }) {
  const channels = Array.from({ length: 4 }, () => new Float64Array(BINS));
  const gain = 2 ** exposure;
  // A step without a common factor with the width, so that all columns are sampled.
  let step = Math.max(1, Math.floor((w * h) / MOST_PIXELS));
  while (step > 1 && w % step === 0) step++;
  let [pixels, black, above] = [0, 0, 0];
  for (let at = 0; at < w * h; at += step) {
    const i = (y + Math.floor(at / w)) * film.width + x + (at % w);
    if (!film.samples[i]) continue;
    pixels++;
    const light = decode(film.words[i] ?? 0);
    const values = [...light, luminanceOf(light)];
    if (Math.max(...light) * gain > 1) above++;
    values.forEach((value, c) => {
      const bin = Math.floor((Math.log2(value * gain) - LOWEST) * 4);
      const channel = channels[c];
      if (channel && bin >= 0) channel[Math.min(bin, BINS - 1)] = (channel[Math.min(bin, BINS - 1)] ?? 0) + 1;
      else if (c === 3) black++;
    });
  }
  const share = 1 / Math.max(pixels, 1);
  for (const channel of channels) for (let i = 0; i < BINS; i++) channel[i] = (channel[i] ?? 0) * share;
  return { channels, black: black * share, above: above * share, pixels };
}
