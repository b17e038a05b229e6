/** The expected time of denoising a picture after its last sample. */

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").Worker} Worker */

/** Seconds, whatever a picture's size, until a worker denoises it and the page has it. */
const BEGIN_S = 0.5;
/** Core seconds for denoising a pixel, where the farm has not denoised any picture yet. */
const CORE_S = 2e-5;

/** Returns the seconds for denoising a pixel: of the scene's pictures, else of other scenes', the median. @param {Scene | undefined} scene @param {Scene[]} others @param {Worker[]} workers */
function denoisingOf(scene, others, workers) {
  const own = scene?.measured?.denoise_s;
  if (own) return own;
  const known = others.flatMap(({ measured }) => measured?.denoise_s ?? []).sort((a, b) => a - b);
  return known[known.length >> 1] ?? CORE_S / Math.max(...workers.map(({ slots }) => slots), 1); // with all cores of one machine
}

/** Returns the expected seconds from a job's last sample until its denoised picture. @param {Scene | undefined} scene @param {Scene[]} others @param {Worker[]} workers @param {number} pixels */
export function denoisingTime(scene, others, workers, pixels) {
  return BEGIN_S + pixels * denoisingOf(scene, others, workers);
}
