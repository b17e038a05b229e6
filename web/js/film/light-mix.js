/**
 * A mix of a picture's light groups: for each a gain in stops, a tint, mute and solo. The mixed colour is the weighted sum of the
 * groups' planes; with all gains 1 it is the picture's colour.
 */

import { encode } from "./rgb9e5.js";

/** Largest gain of a slider, in stops, both ways. */
export const MOST_STOPS = 4;
const WHITE = "#ffffff";

/**
 * @typedef {object} Strip
 * @property {string} name of the light group
 * @property {number} stops
 * @property {string} tint #rrggbb, sRGB
 * @property {boolean} muted
 * @property {boolean} solo
 */

/** @typedef {readonly [number, number, number]} Gain of red, green and blue */

/** @param {string} name @returns {Strip} that leaves its group as rendered */
export const plainStrip = (name) => ({ name, stops: 0, tint: WHITE, muted: false, solo: false });

/** @param {Strip} strip */
export const isPlain = ({ stops, tint, muted, solo }) => stops === 0 && tint === WHITE && !muted && !solo;

/** @param {number} stops rounded to what the slider shows */
export const clampStops = (stops) => Math.min(Math.max(Math.round(stops * 10) / 10, -MOST_STOPS), MOST_STOPS) || 0;

/**
 * Reads the mix of the page's address: NAME:STOPS:RRGGBB:ms for each group that is not plain, separated by commas.
 *
 * @param {string | null} text
 * @param {readonly string[]} groups the job's
 * @returns {readonly Strip[]} one per group
 */
export function mixFrom(text, groups) {
  const asked = new Map(
    (text ?? "").split(",").map((part) => {
      const [name = "", stops, tint = "", marks = ""] = part.split(":");
      const isTint = /^[0-9a-f]{6}$/i.test(tint);
      const strip = {
        stops: clampStops(Number(stops) || 0),
        tint: isTint ? `#${tint.toLowerCase()}` : WHITE,
        muted: marks.includes("m"),
        solo: marks.includes("s"),
      };
      return [name, strip];
    }),
  );
  return groups.map((name) => ({ ...plainStrip(name), ...asked.get(name) }));
}

/** @param {readonly Strip[]} mix @returns {string | null} for the page's address; null where all are plain */
export function mixText(mix) {
  const parts = mix
    .filter((strip) => !isPlain(strip))
    .map(({ name, stops, tint, muted, solo }) => {
      const marks = (muted ? "m" : "") + (solo ? "s" : "");
      return [name, stops || "", tint === WHITE ? "" : tint.slice(1), marks].join(":").replace(/:+$/, "");
    });
  return parts.join(",") || null;
}

/** @param {number} value 0..1, sRGB-coded */
const linear = (value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4);

/** @param {readonly Strip[]} mix @returns {Gain[]} one per group; 0 for muted ones, and for all others where some are solo */
export function gainsOf(mix) {
  const hasSolo = mix.some(({ solo }) => solo);
  return mix.map(({ stops, tint, muted, solo }) => {
    if (hasSolo ? !solo : muted) return [0, 0, 0];
    const gain = 2 ** stops;
    const part = (/** @type {number} */ at) => gain * linear(parseInt(tint.slice(at, at + 2), 16) / 255);
    return [part(1), part(3), part(5)];
  });
}

/** @param {readonly Strip[]} mix @returns {boolean} whether the mixed colour differs from the rendered one */
export const isMixed = (mix) => gainsOf(mix).some((gain) => gain.some((factor) => factor !== 1));

/** @param {readonly Strip[]} mix @returns {Record<string, string>} the service's parameter of a mixed picture */
export function mixQuery(mix) {
  if (!isMixed(mix)) return {};
  const gains = gainsOf(mix);
  return { mix: mix.map(({ name }, i) => `${name}:${gains[i]?.map((factor) => Number(factor.toPrecision(9))).join("/")}`).join(",") };
}

/** Value of a mantissa of 1 by exponent (rgb9e5.js). */
const SCALES = Float64Array.from({ length: 32 }, (_, exponent) => 2 ** (exponent - 24));

/**
 * Mixes planes of RGB9E5 words.
 *
 * @param {readonly Uint32Array[]} planes one per group
 * @param {readonly Gain[]} gains
 * @param {Uint32Array} into of the same length
 */
export function mixWords(planes, gains, into) {
  const used = planes.flatMap((words, i) => {
    const [r, g, b] = gains[i] ?? [0, 0, 0];
    return r || g || b ? [{ words, r, g, b }] : [];
  });
  for (let i = 0; i < into.length; i++) {
    let red = 0;
    let green = 0;
    let blue = 0;
    for (const { words, r, g, b } of used) {
      const word = words[i] ?? 0;
      const scale = SCALES[word >>> 27] ?? 0;
      red += r * scale * (word & 511);
      green += g * scale * ((word >>> 9) & 511);
      blue += b * scale * ((word >>> 18) & 511);
    }
    into[i] = encode(red, green, blue);
  }
}

/**
 * Mixes the exact values of a pixel.
 *
 * @param {Record<string, number[]>} lights by group
 * @param {readonly Strip[]} mix
 * @returns {number[]}
 */
export function mixPixel(lights, mix) {
  const gains = gainsOf(mix);
  return [0, 1, 2].map((c) => mix.reduce((sum, { name }, i) => sum + (lights[name]?.[c] ?? 0) * (gains[i]?.[c] ?? 0), 0));
}
