/** A small picture made large smoothly: what is seen until its own samples are here. */

import { decode } from "../film/rgb9e5.js";
import { Film } from "../film/film.js";

/**
 * @param {Film} film
 * @param {number} width
 * @param {number} height
 * @returns {Film} with no samples of its own
 */
export function enlarged(film, width, height) {
  const { width: w, height: rows, words } = film;
  const linear = new Float32Array(3 * w * rows);
  for (let i = 0; i < words.length; i++) linear.set(decode(words[i] ?? 0), 3 * i);
  const large = new Film(width, height);
  const at = (/** @type {number} */ i) => linear[i] ?? 0;
  for (let y = 0; y < height; y++) {
    const [above, below, fy] = between(y, height, rows);
    for (let x = 0; x < width; x++) {
      const [left, right, fx] = between(x, width, w);
      const [a, b, c, d] = [above * w + left, above * w + right, below * w + left, below * w + right];
      const mixed = (/** @type {number} */ n) =>
        (at(3 * a + n) * (1 - fx) + at(3 * b + n) * fx) * (1 - fy) + (at(3 * c + n) * (1 - fx) + at(3 * d + n) * fx) * fy;
      large.words[y * width + x] = encode(mixed(0), mixed(1), mixed(2));
    }
  }
  return large;
}

/** The texels on both sides of a pixel's centre, and how near it is to the second. @param {number} at @param {number} large @param {number} small @returns {[number, number, number]} */
function between(at, large, small) {
  const place = Math.min(Math.max(((at + 0.5) * small) / large - 0.5, 0), small - 1);
  const first = Math.floor(place);
  return [first, Math.min(first + 1, small - 1), place - first];
}

/** As renderer/image/rgbe9995.py packs. @param {number} r @param {number} g @param {number} b */
function encode(r, g, b) {
  const brightest = Math.max(r, g, b);
  if (!(brightest > 0)) return 0;
  const exponent = Math.min(31, Math.max(-16, Math.floor(Math.log2(brightest * (1 + 2 ** -10)))) + 16);
  const step = 2 ** (24 - exponent);
  const mantissa = (/** @type {number} */ value) => Math.min(511, Math.floor(value * step + 0.5));
  return (mantissa(r) | (mantissa(g) << 9) | (mantissa(b) << 18) | (exponent << 27)) >>> 0;
}
