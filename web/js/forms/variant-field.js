/** The material variant of a glTF file. */

import { choiceField } from "./fields.js";
import { t } from "../base/words.js";

/**
 * @param {import("../base/types.js").Scene} scene
 * @param {string | null} [asked] the initial variant, by name or number; null: the scene's own
 * @returns {{elements: HTMLElement[], get: () => {variant?: string}}} without elements where there is nothing to choose
 */
export function variantField({ variants = [], variant = null }, asked = null) {
  if (!variants.length) return { elements: [], get: () => ({}) };
  // Selected by number, since names may repeat. The scene gives its own by name, or by number if the name is ambiguous.
  const numberOf = (/** @type {string} */ name) => (name ? String(variants.includes(name) ? variants.indexOf(name) : Number(name)) : "");
  const own = numberOf(variant ?? "");
  const choices = [
    { name: "", label: t("The file's own"), help: t("As it was saved.") },
    ...variants.map((label, i) => ({ name: String(i), label, help: "" })),
  ];
  const field = choiceField(t("Materials"), choices, asked === null ? own : numberOf(asked));
  return { elements: [field.element], get: () => (field.get() === own ? {} : { variant: field.get() }) };
}
