/**
 * RGB9E5: three 9-bit mantissas with a shared 5-bit exponent in a 32-bit word, as GL's UNSIGNED_INT_5_9_9_9_REV (OpenGL ES 3.0,
 * 3.8.3.2). 4 bytes per pixel, accurate to 0.2 % of the brightest channel.
 */

/**
 * @param {number} word
 * @returns {[number, number, number]} linear RGB
 */
export function decode(word) {
  const scale = 2 ** ((word >>> 27) - 24); // bias 15, and 9 bits of mantissa
  return [(word & 511) * scale, ((word >>> 9) & 511) * scale, ((word >>> 18) & 511) * scale];
}

const float = new Float32Array(1);
const bits = new Int32Array(float.buffer);
/** 2 ** (24 - exponent), the factor from value to mantissa. */
const STEPS = Float64Array.from({ length: 32 }, (_, exponent) => 2 ** (24 - exponent));

/** Packs as renderer/image/rgbe9995.py. @param {number} r @param {number} g @param {number} b */
export function encode(r, g, b) {
  const brightest = Math.max(r, g, b);
  if (!(brightest > 0)) return 0;
  float[0] = brightest * (1 + 2 ** -10);
  const exponent = Math.min(31, Math.max(0, ((bits[0] ?? 0) >> 23) - 127 + 16));
  const step = STEPS[exponent] ?? 0;
  const red = Math.min(511, Math.floor(r * step + 0.5));
  const green = Math.min(511, Math.floor(g * step + 0.5));
  const blue = Math.min(511, Math.floor(b * step + 0.5));
  return (red | (green << 9) | (blue << 18) | (exponent << 27)) >>> 0;
}
