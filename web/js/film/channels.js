/** Displayable channels of a picture: its light, denoised or not, and its AOVs. */

import { table } from "../news/settings-table.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Channel} Channel */

export const DENOISED = "denoised";

/** @type {Channel} */
const COLOUR = { name: "", label: t("Colour"), help: "", values: ["R", "G", "B"] };

/** @type {Channel} */
export const DENOISED_CHANNEL = { name: DENOISED, label: t("Denoised"), help: "", values: ["R", "G", "B"] };

/** Colour first, then the planes as the service lists them. @returns {Channel[]} */
export function channels() {
  return [COLOUR, ...(table.value?.channels ?? [])];
}

/** @param {string} name @returns {Channel} */
export function channelOf(name) {
  return [...channels(), DENOISED_CHANNEL].find((channel) => channel.name === name) ?? COLOUR;
}
