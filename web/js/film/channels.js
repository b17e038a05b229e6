/** What can be looked at of a picture: its light, denoised or not, and the planes that are rendered with it. */

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
  { name: "", label: "Colour", values: ["R", "G", "B"] },
  { name: "albedo", label: "Albedo", hint: "What the first surface reflects of white light", values: ["R", "G", "B"] },
  { name: "normal", label: "Normal", hint: "Which way the first surface faces, in the world", values: ["X", "Y", "Z"] },
  { name: "depth", label: "Depth", hint: "Distance from the eye to the first surface", values: ["Distance"] },
  { name: "position", label: "Position", hint: "Where the first surface is, in the world", values: ["X", "Y", "Z"] },
  { name: "object", label: "Object id", hint: "A colour for every object", values: ["Object"] },
  { name: "material", label: "Material id", hint: "A colour for every material", values: ["Material"] },
  { name: "samples", label: "Sample count", hint: "Heat map: where the farm spent its samples", values: ["Samples"] },
  { name: "error", label: "Error", hint: "Heat map: how noisy each pixel still is", values: ["Error"] },
];

/** @type {Channel} */
export const DENOISED_CHANNEL = { name: DENOISED, label: "Denoised", values: ["R", "G", "B"] };

/** @param {string} name @returns {Channel} */
export function channelOf(name) {
  const known = [...CHANNELS, DENOISED_CHANNEL].find((channel) => channel.name === name);
  return known ?? /** @type {Channel} */ (CHANNELS[0]);
}
