/** Sizes and qualities that people ask for, and what a request costs. */

import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Worker} Worker */

export const SIZES = [
  { name: "preview", label: t("Preview"), long: 640 },
  { name: "hd", label: "HD", long: 1280 },
  { name: "full-hd", label: "Full HD", long: 1920 },
  { name: "4k", label: "4k", long: 3840 },
];

export const QUALITIES = [
  { name: "draft", label: t("Draft"), spp: 16 },
  { name: "good", label: t("Good"), spp: 128 },
  { name: "final", label: t("Final"), spp: 512 },
  { name: "finest", label: t("Finest"), spp: 2048 },
];

/** The choice beside the presets. */
export const CUSTOM = "custom";

export const DEFAULT_ASPECT = 16 / 9;

/**
 * @param {number} long the longer side, in pixels
 * @param {number} aspect width / height
 */
export function sizeOf(long, aspect) {
  return aspect >= 1
    ? { width: long, height: Math.max(1, Math.round(long / aspect)) }
    : { width: Math.max(1, Math.round(long * aspect)), height: long };
}

/** Seconds from a click to the first samples, however small the picture is. */
const BEGIN_S = 0.5;

/** A few specks may be as noisy as this, whatever the rest of the picture is: nothing is said of it then. */
const NO_PICTURE = 1;

/**
 * What a picture takes on this farm: from what the scene's latest one measured, else from what the workers rendered last,
 * which says nothing of its noise.
 *
 * @param {import("../base/types.js").Scene | undefined} scene
 * @param {Worker[]} workers
 * @param {number} pixels of all frames together
 * @param {number} spp
 * @returns {{seconds: number | null, noise: number | null}}
 */
export function expected(scene, workers, pixels, spp) {
  const samples = pixels * spp;
  const measured = scene?.measured;
  const slots = workers.reduce((sum, { slots }) => sum + slots, 0);
  const others = workers.reduce((sum, { slots, samples_per_s }) => sum + slots * samples_per_s, 0);
  const noise = measured?.noise ? measured.noise / Math.sqrt(spp) : Infinity;
  const speed = measured ? slots / measured.sample_s : others;
  return {
    seconds: speed > 0 ? BEGIN_S + samples / speed : null,
    noise: noise < NO_PICTURE ? noise : null,
  };
}
