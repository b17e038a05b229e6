/** Descriptions of environment light: of a job's request, of a preset, of a sky. */

import { WITHOUT_LIGHT, hasCode } from "./codes.js";
import { hexOf } from "./colour.js";
import { t } from "./words.js";

/** @typedef {import("./types.js").EnvironmentRequest} EnvironmentRequest */
/** @typedef {import("./types.js").Scene} Scene */

/** Whether the file has no light, so that a studio light stands in. @param {Pick<Scene, "codes">} scene */
export const isLightless = ({ codes }) => (codes?.["warnings"] ?? []).some((/** @type {any} */ coded) => hasCode(coded, WITHOUT_LIGHT));

/** The light of a scene's file, or what stands in for it. @param {Pick<Scene, "codes"> | undefined} scene */
export const ownLight = (scene) => (scene && isLightless(scene) ? t("Soft studio light") : t("The scene's own"));

/** @param {string} id "dark-studio" @returns {string} "Dark studio" */
const presetName = (id) => t((id[0]?.toUpperCase() ?? "") + id.slice(1).replaceAll("-", " "));

/** @param {number} value degrees */
const degrees = (value) => `${Number(value.toFixed(1))}°`;

/** @param {{elevation: number, azimuth?: number | null}} sky */
function skyWords({ elevation, azimuth }) {
  const height = elevation < 0 ? t("{elevation} below the horizon", { elevation: degrees(-elevation) }) : t("at {elevation} elevation", { elevation: degrees(elevation) });
  return t("Clear sky, sun {height}, {azimuth}", { height, azimuth: degrees((((azimuth ?? 0) % 360) + 360) % 360) });
}

/** @param {EnvironmentRequest | null | undefined} light @returns {string} empty: the scene's own */
function kindOf(light) {
  if (!light) return "";
  if (light.sky) return skyWords(light.sky);
  if (light.preset) return presetName(light.preset);
  if (light.image) return light.name ?? t("An uploaded image");
  if (!light.color) return "";
  const [r, g, b] = light.color;
  if (r === g && g === b) return r === 1 ? t("Even white") : r === 0 ? t("Black") : t("Even grey of {value}", { value: Number(r.toPrecision(3)) });
  return t("One colour, {color}", { color: hexOf(light.color) });
}

/**
 * "Clear sky, sun at 35° elevation, 120°", "studio.exr, turned by 30°, strength 2".
 *
 * @param {EnvironmentRequest | null | undefined} light
 * @param {Pick<Scene, "environment">} [scene] for jobs of older releases, which use their scene's light
 * @returns {string} empty: the scene's own, as it is
 */
export function lightWords(light, scene) {
  const { rotation = 0, strength = 1 } = light ?? {};
  const kind = kindOf(light) || ofScene(scene);
  const changes = [rotation !== 0 && t("turned by {rotation}", { rotation: degrees(rotation) }), strength !== 1 && t("strength {strength}", { strength })].filter(Boolean);
  if (!changes.length) return kind;
  return [kind || t("The scene's own"), ...changes].join(", ");
}

/** @param {Pick<Scene, "environment"> | undefined} scene */
function ofScene({ environment = null } = {}) {
  const sky = /^sky:([^,]*),?(.*)$/.exec(environment ?? "");
  if (sky) return skyWords({ elevation: Number(sky[1]), azimuth: Number(sky[2] || 0) });
  const file = environment?.split("/").at(-1) ?? "";
  return file.includes(".") || !file ? file : presetName(file);
}
