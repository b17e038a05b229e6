/** Displayable channels of a picture: its light, denoised or not, and its AOVs. */

import { table } from "../news/settings-table.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Channel} Channel */

export const DENOISED = "denoised";

/** @type {Channel} */
const COLOUR = { name: "", label: t("Colour"), help: "", values: ["R", "G", "B"] };

/** @type {Channel} */
export const DENOISED_CHANNEL = { name: DENOISED, label: t("Denoised"), help: "", values: ["R", "G", "B"] };

/** The colour as a mix of the light groups' planes (light-mix.js). */
export const MIX = "mix";

/** The same of the denoised light groups; of the raw ones while there are none. */
export const DENOISED_MIX = "denoised-mix";

/** @type {Channel} */
const DENOISED_MIX_CHANNEL = { name: DENOISED_MIX, label: t("Light mix, denoised"), help: "", values: ["R", "G", "B"] };

/** @type {Channel} */
const MIX_CHANNEL = { name: MIX, label: t("Light mix"), help: "", values: ["R", "G", "B"] };

/** Only of jobs with a transparent background. @type {Channel} */
const ALPHA_CHANNEL = { name: "alpha", label: t("Alpha"), help: t("How much of the pixel is covered"), values: [t("Alpha")] };

/** What the name of a light group's channel begins with. */
const LIGHT = "light:";

/** The group of lights that have no group of their own; renderer/settings.py has it last. */
const REST = "rest";

/** What the name of a light path's plane and channel begins with: renderer/settings.py. */
const PATH = "path:";

/** The light paths, in the order of renderer/settings.py. @type {[string, string][]} */
const PATHS = [
  ["emission", t("Emission")],
  ["environment", t("Environment")],
  ["diffuse_direct", t("Diffuse, direct")],
  ["diffuse_indirect", t("Diffuse, indirect")],
  ["glossy_direct", t("Glossy, direct")],
  ["glossy_indirect", t("Glossy, indirect")],
  ["transmission_direct", t("Transmission, direct")],
  ["transmission_indirect", t("Transmission, indirect")],
  ["volume_direct", t("Volume, direct")],
  ["volume_indirect", t("Volume, indirect")],
];

/** @type {Channel[]} */
const PATH_CHANNELS = PATHS.map(([name, label]) => ({
  name: PATH + name,
  label,
  help: t("Contribution of these light paths to the colour"),
  values: ["R", "G", "B"],
}));

/** @param {string} name @returns {string | null} the light group or path that a channel shows; null for other channels */
export const lightGroupOf = (name) => (name.startsWith(PATH) ? name : name.startsWith(LIGHT) ? name.slice(LIGHT.length) : null);

/** @param {string} group @returns {string} the channel that shows a light group */
export const channelOfLight = (group) => LIGHT + group;

/** @param {string} group @returns {string} its name for people */
export const lightName = (group) => (group === REST ? t("All others") : group === "environment" ? t("Environment") : group);

/** @param {Record<string, any> | null} settings a job's @returns {string[]} the names of its light groups; [] without any */
export const lightGroups = (settings) => (settings?.light_groups ? [...settings.light_groups.split(","), REST] : []);

/** @param {string} group @returns {Channel} */
const lightChannel = (group) => ({
  name: LIGHT + group,
  label: group === REST ? t("Light: all others") : t("Light: {group}", { group }),
  help: t("Contribution of this light group to the colour"),
  values: ["R", "G", "B"],
});

/**
 * Colour first, then the planes as the service lists them, then the job's light groups and light paths.
 *
 * @param {Record<string, any> | null} [settings] the job's
 * @returns {Channel[]}
 */
export function channels(settings = null) {
  const alpha = settings?.background === "transparent" ? [ALPHA_CHANNEL] : [];
  const paths = settings?.light_paths === "on" ? PATH_CHANNELS : [];
  return [COLOUR, ...(table.value?.channels ?? []), ...alpha, ...lightGroups(settings).map(lightChannel), ...paths];
}

/** @param {string} name @returns {Channel} */
export function channelOf(name) {
  const path = PATH_CHANNELS.find((channel) => channel.name === name);
  if (path) return path;
  const group = lightGroupOf(name);
  if (group !== null) return lightChannel(group);
  return [...channels(), ALPHA_CHANNEL, DENOISED_CHANNEL, MIX_CHANNEL, DENOISED_MIX_CHANNEL].find((channel) => channel.name === name) ?? COLOUR;
}
