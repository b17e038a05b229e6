/** Formatting of numbers, sizes and times. */

import { grouped, t, tn } from "./words.js";

/**
 * 1,234,567 -> "1.23 M". Three significant digits, decimal prefixes.
 *
 * @param {number} value
 */
export function compact(value) {
  const prefixes = /** @type {const} */ ([
    [1e12, " T"],
    [1e9, " G"],
    [1e6, " M"],
    [1e3, " k"],
  ]);
  for (const [size, prefix] of prefixes) if (Math.abs(value) >= size) return `${significant(value / size)}${prefix}`;
  return significant(value);
}

/** @param {number} value */
function significant(value) {
  return Number(value.toPrecision(3)).toString();
}

/**
 * Sizes along the axes: "4 × 3 × 2.5"; very large or small ones as "4 × 3 × 2.5 · 10⁵".
 *
 * @param {number[]} sizes
 */
export function extent(sizes) {
  const power = Math.floor(Math.log10(Math.max(...sizes) || 1));
  const plain = power >= -2 && power <= 3;
  const scaled = sizes.map((size) => significant(plain ? size : size / 10 ** power)).join(" × ");
  return plain ? scaled : `${scaled} · 10${[...String(power)].map((c) => SUPERSCRIPT[c]).join("")}`;
}

/** @type {Record<string, string>} */
const SUPERSCRIPT = Object.fromEntries([..."0123456789-"].map((c, i) => [c, [..."⁰¹²³⁴⁵⁶⁷⁸⁹⁻"][i] ?? c]));

/** @param {number} value */
export function count(value) {
  return grouped(value);
}

/** @param {number} n */
export function bytes(n) {
  if (n < 1000) return `${n} B`;
  return `${compact(n)}B`.replace(" kB", " kB");
}

/**
 * A duration as on a clock: "0:07", "2:05", "1:02:05"; from two days on "3 d 4 h".
 *
 * @param {number} seconds
 */
export function clock(seconds) {
  const s = Math.max(0, Math.round(seconds));
  const two = (/** @type {number} */ n) => String(n).padStart(2, "0");
  const minutes = Math.floor(s / 60);
  const hours = Math.floor(minutes / 60);
  if (hours >= 48) return t("{days} d {hours} h", { days: Math.floor(hours / 24), hours: hours % 24 });
  if (minutes < 60) return `${minutes}:${two(s % 60)}`;
  return `${hours}:${two(minutes % 60)}:${two(s % 60)}`;
}

/**
 * An estimated duration in words: "about 3 s", "about 2 min", "about 5 h".
 *
 * @param {number} seconds
 */
export function roughly(seconds) {
  if (seconds < 1) return t("under a second");
  if (seconds < 90) return t("about {n} s", { n: Math.round(seconds) });
  if (seconds < 90 * 60) return t("about {n} min", { n: Math.round(seconds / 60) });
  if (seconds < 36 * 3600) return t("about {n} h", { n: Math.round(seconds / 3600) });
  return tn(Math.round(seconds / 86400), "about {n} day", "about {n} days");
}

/** A duration with its unit: "30 s", "1.5 min". @param {number} seconds */
export function durationText(seconds) {
  const n = (/** @type {number} */ size) => Number((seconds / size).toPrecision(2));
  if (seconds < 60) return t("{n} s", { n: n(1) });
  if (seconds < 3600) return t("{n} min", { n: n(60) });
  if (seconds < 86400) return t("{n} h", { n: n(3600) });
  return t("{n} d", { n: n(86400) });
}

/** A relative noise: "0.8 %". @param {number} noise */
export const noiseText = (noise) => `${Number((noise * 100).toPrecision(noise < 0.1 ? 1 : 2))} %`;

/**
 * A moment in the past: "just now", "3 min ago".
 *
 * @param {number} then unix seconds
 * @param {number} [now]
 */
export function ago(then, now = Date.now() / 1000) {
  const s = now - then;
  if (s < 10) return t("just now");
  if (s < 60) return t("{n} s ago", { n: Math.floor(s / 10) * 10 });
  if (s < 3600) return t("{n} min ago", { n: Math.floor(s / 60) });
  if (s < 86400) return t("{n} h ago", { n: Math.floor(s / 3600) });
  if (s < 30 * 86400) return tn(Math.floor(s / 86400), "{n} day ago", "{n} days ago");
  return new Date(then * 1000).toISOString().slice(0, 10);
}

/**
 * A film value with four significant digits, formatted to a steady width: "0.1234", "12.35", "1.2e-5".
 *
 * @param {number} value
 */
export function radiance(value) {
  const size = Math.abs(value);
  if (value === 0) return "0";
  if (size < 1e-3 || size >= 1e5) return value.toExponential(2);
  return size >= 1 ? value.toPrecision(4) : value.toFixed(4);
}

/** @param {number} stops */
export function stops(stops) {
  return `${stops < 0 ? "−" : "+"}${Math.abs(stops).toFixed(1)}`;
}

/** @param {number} fraction */
export function percent(fraction) {
  const p = fraction * 100;
  return `${p >= 99.95 || p < 0.05 || p >= 10 ? Math.floor(p + 1e-9) : p.toFixed(1)} %`;
}
