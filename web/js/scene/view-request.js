/** What a live view requests: the form's request, without the fields that only jobs have, at the view's size on the page. */

import { parseFrames } from "../base/frame-numbers.js";

const LEAST_SIDE = 16;
/** Request fields that do not apply to a view. */
const JOB_ONLY_FIELDS = ["denoise", "fresh", "spp", "noise", "seconds", "frames", "order", "every", "name", "priority", "tile_size", "scene"];

/** Gives a view's frame the shape of its picture, by which css/workspace.css also places what is below it. @param {HTMLElement} frame @param {number} aspect width / height */
export function shapeView(frame, aspect) {
  for (const each of [frame, document.documentElement]) each.style.setProperty("--aspect", String(aspect));
}

/** Returns the fields of a form's request that a view reads. @param {Record<string, any>} request @returns {Record<string, any>} */
export function viewRequest(request) {
  /** @type {Record<string, any>} */
  const found = { ...request };
  if (found.frames) found.frame = firstOf(found.frames);
  for (const name of JOB_ONLY_FIELDS) delete found[name];
  return found;
}

/** @param {string} frames of a shot */
function firstOf(frames) {
  const numbers = parseFrames(frames);
  return typeof numbers === "string" ? 0 : (numbers[0] ?? 0);
}

/**
 * Returns the view's size on screen, in pixels, with the picture's aspect ratio.
 *
 * @param {number} width of the requested picture
 * @param {number} height
 * @param {number} wide the view, in CSS pixels; 0: not known yet
 * @param {number} mostPixels
 */
export function sizeFor(width, height, wide, mostPixels) {
  const most = Math.max(LEAST_SIDE, (wide || 320) * Math.min(devicePixelRatio, 2));
  const scale = Math.min(most / width, Math.sqrt(mostPixels / (width * height)));
  return { width: Math.max(1, Math.round(width * scale)), height: Math.max(1, Math.round(height * scale)) };
}
