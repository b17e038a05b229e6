/** Error metrics of two pictures: a map of all pixels, and overall figures. The first is the reference. */

import { HEAT } from "../film/colour-map.js";
import { decode } from "../film/rgb9e5.js";
import { flip } from "./flip.js";

/**
 * @typedef {object} Pair
 * @property {number} width
 * @property {number} height
 * @property {Uint32Array | null} wordsA linear light as RGB9E5; null: the displayed colours are compared instead
 * @property {Uint32Array | null} wordsB
 * @property {Uint8Array} shownA RGBA as on the screen, sRGB-coded
 * @property {Uint8Array} shownB
 * @property {ErrorKind} kind of the map
 *
 * @typedef {"difference" | "relative" | "flip"} ErrorKind
 *
 * @typedef {object} Errors
 * @property {number} mse mean of the squared differences
 * @property {number} relMse each divided by the reference's square and 0.01
 * @property {number} flip mean
 * @property {Uint8ClampedArray<ArrayBuffer>} map RGBA
 * @property {number} high what the map's last colour stands for
 */

/** Added to the reference's square, to limit the weight of black pixels. */
const EPSILON = 0.01;
/** Larger values are clamped to this quantile. */
const QUANTILE = 0.99;

/** @param {Pair} pair @returns {Errors} */
export function errorsOf({ width, height, wordsA, wordsB, shownA, shownB, kind }) {
  const pixels = width * height;
  const light = (/** @type {Uint32Array | null} */ words, /** @type {Uint8Array} */ shown, /** @type {number} */ i) =>
    wordsA && wordsB && words
      ? decode(words[i] ?? 0)
      : [0, 1, 2].map((c) => (shown[4 * i + c] ?? 0) / 255);
  const difference = new Float32Array(pixels);
  const relative = new Float32Array(pixels);
  let [square, ratio] = [0, 0];
  for (let i = 0; i < pixels; i++) {
    const a = light(wordsA, shownA, i);
    const b = light(wordsB, shownB, i);
    let [d, r] = [0, 0];
    for (let c = 0; c < 3; c++) {
      const error = ((a[c] ?? 0) - (b[c] ?? 0)) ** 2;
      d += error / 3;
      r += error / ((a[c] ?? 0) ** 2 + EPSILON) / 3;
    }
    square += d;
    ratio += r;
    difference[i] = Math.sqrt(d);
    relative[i] = r;
  }
  const seen = flip(shownA, shownB, width, height);
  const map = { difference, relative, flip: seen.map }[kind];
  const high = kind === "flip" ? 1 : quantile(map, QUANTILE) || 1;
  return { mse: square / pixels, relMse: ratio / pixels, flip: seen.mean, map: heat(map, high), high };
}

/** @param {Float32Array} values @param {number} at 0..1 */
function quantile(values, at) {
  const sorted = Float32Array.from(values).sort();
  return sorted[Math.floor((sorted.length - 1) * at)] ?? 0;
}

/** @param {Float32Array} values @param {number} high */
function heat(values, high) {
  const rgba = new Uint8ClampedArray(4 * values.length);
  for (let i = 0; i < values.length; i++) {
    const at = Math.min(Math.max((values[i] ?? 0) / high, 0), 1) * (HEAT.length - 1);
    const low = Math.min(Math.floor(at), HEAT.length - 2);
    for (let c = 0; c < 3; c++) {
      const [from = 0, to = 0] = [HEAT[low]?.[c], HEAT[low + 1]?.[c]];
      rgba[4 * i + c] = 255 * (from + (to - from) * (at - low));
    }
    rgba[4 * i + 3] = 255;
  }
  return rgba;
}
