/** Frame ranges as text: `0-99`, `1-250x5,300` or `0-10x0.5`. Same syntax as renderer/frames.py. */

import { t } from "./words.js";

const MOST_FRAMES = 100_000;
const PART = /^(\d{1,8}(?:\.[05])?)(?:-(\d{1,8}(?:\.[05])?)(?:[x:](\d{1,8}(?:\.[05])?))?)?$/;

/**
 * @param {string} text
 * @returns {number[] | string} in the order written, without duplicates; or an error message
 */
export function parseFrames(text) {
  /** @type {Set<number>} */
  const found = new Set();
  for (const part of text.replaceAll(" ", "").split(",")) {
    const match = PART.exec(part);
    if (!match) return t("Frames are numbers and ranges as 0-99 or 1-250x5,300.");
    const first = Number(match[1]);
    const last = Number(match[2] ?? first);
    const step = Number(match[3] ?? 1);
    if (last < first) return t("The range {part} ends before it begins.", { part });
    if (step === 0) return t("The step of a range is at least 0.5.");
    const count = Math.floor((last - first) / step) + 1;
    if (found.size + count > MOST_FRAMES) return t("At most {most} frames are rendered in one shot.", { most: MOST_FRAMES });
    for (let i = 0; i < count; i++) found.add(first + step * i);
  }
  return [...found];
}

/**
 * Formats frame numbers as ranges: [0, 1, 2, 7] is "0-2,7".
 *
 * @param {number[]} frames
 */
export function framesText(frames) {
  /** @type {[number, number][]} */
  const runs = [];
  for (const frame of [...frames].sort((a, b) => a - b)) {
    const last = runs.at(-1);
    if (last && frame === last[1] + 1) last[1] = frame;
    else runs.push([frame, frame]);
  }
  return runs.map(([a, b]) => (a === b ? String(a) : `${a}-${b}`)).join(",");
}
