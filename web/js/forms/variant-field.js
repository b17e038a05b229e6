/** Which of a glTF file's variants of its materials is shown. */

import { choiceField } from "./fields.js";
import { t } from "../base/words.js";

/**
 * @param {import("../base/types.js").Scene} scene
 * @param {string | null} [asked] what it shows first, by name or number, where that is not the scene's own
 * @returns {{elements: HTMLElement[], get: () => {variant?: string}}} without elements where there is nothing to choose
 */
export function variantField({ variants = [], variant = null }, asked = null) {
  if (!variants.length) return { elements: [], get: () => ({}) };
  // By number: names may be alike. The scene's own comes by its name, or by its number where another has that name too.
  const numberOf = (/** @type {string} */ name) => (name ? String(variants.includes(name) ? variants.indexOf(name) : Number(name)) : "");
  const own = numberOf(variant ?? "");
  const choices = [
    { name: "", label: t("The file's own"), help: t("As it was saved.") },
    ...variants.map((label, i) => ({ name: String(i), label, help: "" })),
  ];
  const field = choiceField(t("Materials"), choices, asked === null ? own : numberOf(asked));
  return { elements: [field.element], get: () => (field.get() === own ? {} : { variant: field.get() }) };
}
