/**
 * RGB9E5: three 9-bit mantissas under one 5-bit exponent in a 32-bit word, as GL's UNSIGNED_INT_5_9_9_9_REV
 * (OpenGL ES 3.0, 3.8.3.2). 4 bytes a pixel, true to 0.2 % of the brightest channel.
 */

/**
 * @param {number} word
 * @returns {[number, number, number]} linear RGB
 */
export function decode(word) {
  const scale = 2 ** ((word >>> 27) - 24); // bias 15, and 9 bits of mantissa
  return [(word & 511) * scale, ((word >>> 9) & 511) * scale, ((word >>> 18) & 511) * scale];
}

/**
 * The brightest of the three channels.
 *
 * @param {number} word
 */
export function peak(word) {
  return Math.max(word & 511, (word >>> 9) & 511, (word >>> 18) & 511) * 2 ** ((word >>> 27) - 24);
}
