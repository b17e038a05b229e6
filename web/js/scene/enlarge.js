/** Smooth enlargement of a small picture, shown until the full-size samples arrive. */

import { decode, encode } from "../film/rgb9e5.js";
import { Film } from "../film/film.js";

/**
 * @param {Film} film
 * @param {number} width
 * @param {number} height
 * @returns {Film} the enlarged picture, without sample counts
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

/**
 * The two texels around a pixel's centre, and the weight of the second.
 * @param {number} at
 * @param {number} large
 * @param {number} small
 * @returns {[number, number, number]}
 */
function between(at, large, small) {
  const place = Math.min(Math.max(((at + 0.5) * small) / large - 0.5, 0), small - 1);
  const first = Math.floor(place);
  return [first, Math.min(first + 1, small - 1), place - first];
}
