/** Tells apart scenes with the same files and name, by material variant and environment light. */

import { lightWords } from "./light-words.js";

/** @typedef {import("./types.js").Scene} Scene */

/** @param {Pick<Scene, "variant" | "variants"> | undefined} scene @returns {string} empty: the file's own */
export function variantOf({ variant = null, variants = [] } = {}) {
  if (!variant || variants.includes(variant)) return variant ?? "";
  return variants[Number(variant)] ? `${variants[Number(variant)]} (${variant})` : variant; // another variant has the same name
}

/** @param {Pick<Scene, "environment"> | undefined} scene @returns {string} empty: the scene's own */
export const lightOf = (scene) => lightWords(null, scene);
