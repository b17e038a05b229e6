/** Measures the brightness of a picture, by which its exposure is chosen. */

/**
 * white, bright, high: radiances that all but the brightest 0.5 %, 3 % and 10 % of the pixels stay below (WHITE_QUANTILE, BRIGHT_QUANTILE,
 * HIGH_QUANTILE). key: the log-average luminance (Reinhard et al. 2002, equation 1) with luminances clipped at the HIGH_QUANTILE, so that
 * lamps do not raise it, and without SHADOW. All are 0 for a black picture.
 *
 * @typedef {{white: number, bright: number, high: number, key: number}} Brightness
 */

/** Approximate number of pixels that are measured: enough for a percentile, in a few milliseconds. */
const MEASURED = 25_000;
/** The brightest 0.5 % (lamps, fireflies) may clip. The brightest 3 % are lit surfaces where there is sun, the brightest tenth a window or a sky. */
const [WHITE_QUANTILE, BRIGHT_QUANTILE, HIGH_QUANTILE] = [0.995, 0.97, 0.9];
/** Luminance, as a fraction of the HIGH_QUANTILE, below which a pixel is background or deep shadow and does not count in the key. */
const SHADOW = 2 ** -8;

/**
 * Returns the brightness of a picture.
 *
 * @param {number} pixels their number
 * @param {(pixel: number) => [number, number, number] | null} at returns the radiance of a pixel; null: it does not count
 * @returns {Brightness}
 */
export function brightnessOf(pixels, at) {
  const stride = Math.max(1, Math.floor(pixels / MEASURED));
  const most = Math.ceil(pixels / stride);
  const [allPeaks, allLuminances] = [new Float32Array(most), new Float32Array(most)];
  let n = 0;
  for (let i = 0; i < pixels; i += stride) {
    const color = at(i);
    if (!color) continue;
    const [r, g, b] = color;
    allPeaks[n] = Math.max(r, g, b);
    allLuminances[n++] = 0.2126 * r + 0.7152 * g + 0.0722 * b;
  }
  const [peaks, luminances] = [allPeaks.subarray(0, n).sort(), allLuminances.subarray(0, n).sort()];
  const top = quantile(luminances, HIGH_QUANTILE);
  const lit = luminances.filter((each) => each > SHADOW * top).map((each) => Math.log(Math.min(each, top)));
  const key = top > 0 ? Math.exp(lit.reduce((sum, each) => sum + each, 0) / lit.length) : 0;
  return { white: quantile(peaks, WHITE_QUANTILE), bright: quantile(peaks, BRIGHT_QUANTILE), high: quantile(peaks, HIGH_QUANTILE), key };
}

/** @param {Float32Array} sorted @param {number} part */
const quantile = (sorted, part) => sorted[Math.floor((sorted.length - 1) * part)] ?? 0;
