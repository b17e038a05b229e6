/** Codes of the service's messages that the page acts on; never by their text. */

/** @typedef {import("./said.js").Coded} Coded */

/** A scene refers to a file that was not uploaded: adding it is the remedy. */
export const MISSING_FILE = [
  "environment-not-in-scene",
  "file-missing",
  "file-not-in-scene",
  "gltf-light-profile-missing",
  "gltf-uri-not-in-files",
  "mitsuba-file-missing",
  "mitsuba-include-missing",
  "mitsuba-referenced-file-missing",
  "obj-material-files-missing",
  "obj-material-library-missing",
  "pbrt-include-missing",
  "pbrt-spectrum-unknown",
  "texture-config-missing",
  "texture-file-missing",
  "usd-file-not-in-files",
  "usd-ies-profile-missing",
  "usd-materialx-include-missing",
];

/** Parameters of these messages that name the missing file. */
const NAME_PARAMS = ["texture", "libraries", "document", "layer", "uri", "name"];

/** Guesses of readers where a file leaves something open: nothing of the file is lost. */
export const GUESSED = [
  "collada-camera-aspect-guessed",
  "image-colour-profile-ignored",
  "mesh-decimal-commas",
  "mtl-bump-read-as-normal",
  "mtl-decimal-commas",
  "names-encoding-guessed",
  "names-encoding-likely",
  "obj-image-guessed",
  "obj-library-guessed",
  "points-shown-as-spheres",
  "up-axis-guessed",
  "usd-metadata-not-double",
];

/** Codes of two of these notes: their sentences name places in the file. */
export const [PROFILE_IGNORED, IMAGE_GUESSED] = ["image-colour-profile-ignored", "obj-image-guessed"];

/** The upload has several scenes: `file` is shown, not `others`. */
export const SEVERAL_SCENES = "scene-files-several";

/** The file has no light, so a studio light stands in: not an error of the file. */
export const WITHOUT_LIGHT = "scene-without-light";

/** Nothing of a scene can be seen from any side and in any light, in no frame (renderer/scene/visible_surfaces.py). */
export const WITHOUT_AREA = "scene-without-area";

/** The same of a scene as it was uploaded: in its first frame, and in its usual variant. */
export const INVISIBLE = [WITHOUT_AREA, "scene-without-area-at-frame", "scene-invisible"];

/** The warnings of a strict scene are its error. */
export const STRICT = ["strict-scene-warning", "strict-scene-warnings"];

/** A compressed file of a supported format: the remedy is to unpack it. */
export const UNPACK = "advice-unpack-archive";

/** A scene waits for a worker with Blender, and there is none. */
export const WAITS_FOR_BLENDER = "waits-for-blender-worker";

/** A worker was paused by the farm, because its batches failed or its results were wrong. */
export const QUARANTINED = ["worker-quarantined", "worker-quarantined-failures"];

/**
 * The names of the missing files that a message is about; empty if it is not about any, or does not name them.
 *
 * @param {Coded | null | undefined} coded
 * @returns {string[]}
 */
export function missingFiles(coded) {
  if (!hasCode(coded, MISSING_FILE)) return [];
  const name = NAME_PARAMS.map((param) => coded?.params?.[param]).find((value) => typeof value === "string" || Array.isArray(value));
  return name === undefined ? [] : [name].flat();
}

/**
 * Returns true if a message, or one within it, has one of these codes.
 *
 * @param {Coded | null | undefined} coded
 * @param {string | string[]} codes
 * @returns {boolean}
 */
export function hasCode(coded, codes) {
  if (!coded) return false;
  const within = (/** @type {any} */ value) => (Array.isArray(value) ? value.some(within) : typeof value === "object" && hasCode(value, codes));
  return [codes].flat().includes(coded.code) || Object.values(coded.params ?? {}).some(within);
}
