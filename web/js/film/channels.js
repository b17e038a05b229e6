/** What can be looked at of a picture: its light, denoised or not, and the planes that are rendered with it. */

import { t } from "../base/words.js";

/**
 * @typedef {object} Channel
 * @property {string} name "" for the light as it is; else the service's name of the plane, or DENOISED
 * @property {string} label
 * @property {string} [hint]
 * @property {string[]} values the names of a pixel's numbers
 */

export const DENOISED = "denoised";

/** @type {Channel[]} */
export const CHANNELS = [
  { name: "", label: t("Colour"), values: ["R", "G", "B"] },
  { name: "albedo", label: t("Albedo"), hint: t("What the first surface reflects of white light"), values: ["R", "G", "B"] },
  { name: "normal", label: t("Normal"), hint: t("Which way the first surface faces, in the world"), values: ["X", "Y", "Z"] },
  { name: "depth", label: t("Depth"), hint: t("Distance from the eye to the first surface"), values: [t("Distance")] },
  { name: "position", label: t("Position"), hint: t("Where the first surface is, in the world"), values: ["X", "Y", "Z"] },
  { name: "object", label: t("Object id"), hint: t("A colour for every object"), values: [t("Object")] },
  { name: "material", label: t("Material id"), hint: t("A colour for every material"), values: [t("Material")] },
  { name: "samples", label: t("Sample count"), hint: t("Heat map: where the farm spent its samples"), values: [t("Samples")] },
  { name: "error", label: t("Error"), hint: t("Heat map: how noisy each pixel still is"), values: [t("Error")] },
];

/** @type {Channel} */
export const DENOISED_CHANNEL = { name: DENOISED, label: t("Denoised"), values: ["R", "G", "B"] };

/** @param {string} name @returns {Channel} */
export function channelOf(name) {
  const known = [...CHANNELS, DENOISED_CHANNEL].find((channel) => channel.name === name);
  return known ?? /** @type {Channel} */ (CHANNELS[0]);
}
