/** Scenes of the same files and the same name are told apart by their materials' variant and by the light from around. */

import { lightWords } from "./light-words.js";

/** @typedef {import("./types.js").Scene} Scene */

/** @param {Pick<Scene, "variant" | "variants"> | undefined} scene @returns {string} empty: the file's own */
export function variantOf({ variant = null, variants = [] } = {}) {
  if (!variant || variants.includes(variant)) return variant ?? "";
  return variants[Number(variant)] ? `${variants[Number(variant)]} (${variant})` : variant; // another one has that name too
}

/** @param {Pick<Scene, "environment"> | undefined} scene @returns {string} empty: the scene's own */
export const lightOf = (scene) => lightWords(null, scene);
