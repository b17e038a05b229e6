/** Luminance, and conversion between sRGB colours of the page's colour fields and the linear light that the renderer uses. */

/** @param {readonly number[]} light linear Rec.709 @returns {number} */
export const luminanceOf = ([r = 0, g = 0, b = 0]) => 0.2126 * r + 0.7152 * g + 0.0722 * b;

/**
 * @param {string} hex "#rrggbb"
 * @returns {[number, number, number]} linear Rec.709, 0..1
 */
export function linearOf(hex) {
  const channel = (/** @type {number} */ at) => {
    const v = parseInt(hex.slice(at, at + 2), 16) / 255;
    return v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4;
  };
  return [channel(1), channel(3), channel(5)];
}

/**
 * @param {[number, number, number]} linear Rec.709; values above 1 are clipped
 * @returns {string} "#rrggbb"
 */
export function hexOf(linear) {
  const channel = (/** @type {number} */ v) => {
    const coded = v <= 0.0031308 ? v * 12.92 : 1.055 * v ** (1 / 2.4) - 0.055;
    return Math.round(Math.min(Math.max(coded, 0), 1) * 255)
      .toString(16)
      .padStart(2, "0");
  };
  return `#${linear.map(channel).join("")}`;
}
