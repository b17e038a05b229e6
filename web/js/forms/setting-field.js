/** The field of one setting: a choice, names, a number, or a grey for a colour. */

import { choiceField, field, numberInput, setTip } from "./fields.js";
import { addReset } from "./reset.js";
import { h } from "../base/dom.js";
import { addSlider } from "./slider.js";
import { labelOf } from "../news/settings-table.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Setting} Setting */

/** Maximum number of light groups of a job (MAX_LIGHT_GROUPS in renderer/settings.py). */
export const MOST_GROUPS = 16;

/**
 * @typedef {object} SettingField
 * @property {Setting} setting
 * @property {HTMLElement} element
 * @property {() => any} get in the renderer's terms
 */

/**
 * @param {Setting} setting
 * @param {any} start what it shows first
 * @param {() => void} [changed] by the user
 * @param {any} [own] what it is where it is left alone: the way back leads there
 * @returns {SettingField}
 */
export function settingField(setting, start, changed, own = setting.default) {
  if (setting.choices) {
    const { element, get } = choiceField(setting.label, setting.choices, start, changed);
    addReset(element, /** @type {HTMLSelectElement} */ (element.querySelector("select")), own);
    return { setting, element, get };
  }
  if (setting.type === "names") {
    const input = h("input", { type: "text", value: start ?? "", spellcheck: "false", autocomplete: "off", placeholder: t("none") });
    const element = withTip(field(setting.label, input), input, setting);
    addReset(element, input, own ?? "");
    return { setting, element, get: () => input.value.trim() };
  }
  const isColour = Array.isArray(setting.default);
  const input = numberFor(setting, isColour ? start[0] : start);
  if (changed) input.addEventListener("input", changed);
  const element = withTip(field(labelOf(setting), input), input, setting);
  addSlider(setting, input);
  addReset(element, input, numberFor(setting, isColour ? own[0] : own).value);
  // A grey, unless the scene's colour is unchanged.
  const grey = () => (input.valueAsNumber === start[0] ? start : Array(3).fill(input.valueAsNumber));
  return { setting, element, get: isColour ? grey : () => numberIn(setting, input) };
}

/** @param {HTMLElement} element @param {HTMLElement} input @param {Setting} setting */
function withTip(element, input, { help }) {
  setTip(element, input, help);
  return element;
}

/**
 * The switch of the setting `light_groups`: planes for all groups of the scene, or none. An earlier job's choice of groups is kept
 * while the switch is on.
 *
 * @param {Setting} setting
 * @param {string} start
 * @param {() => void} changed by the user
 * @param {string} _own
 * @param {string[]} groups of the scene
 * @returns {SettingField}
 */
export function groupsField(setting, start, changed, _own, groups) {
  const input = h("input", { type: "checkbox", role: "switch", checked: Boolean(start), onchange: changed });
  const element = h("label", { class: "check" }, input, t("Separate lights"));
  setTip(element, input, t("The brightness and colour of each light can be changed after rendering: {groups}.", { groups: groups.join(", ") }));
  const names = start || groups.slice(0, MOST_GROUPS).join(",");
  return { setting, element, get: () => (input.checked ? names : "") };
}

/**
 * The switch of the setting `background`: transparent, or visible.
 *
 * @param {Setting} setting
 * @param {string} start
 * @param {() => void} changed by the user
 * @returns {SettingField}
 */
export function backgroundField(setting, start, changed) {
  const input = h("input", { type: "checkbox", role: "switch", checked: start === "transparent", onchange: changed });
  const element = h("div", { class: "field" }, h("label", { class: "check" }, input, t("Transparent background")));
  return { setting, element, get: () => (input.checked ? "transparent" : "visible") };
}

/**
 * The field's number; empty for no value and for the value that disables the setting.
 *
 * @param {Setting} setting
 * @param {number | null} value
 */
export function numberFor(setting, value) {
  const { minimum, maximum, off, type } = setting;
  const isOff = value == null || value === off?.value;
  return numberInput({
    value: isOff ? "" : shownAs(setting, value),
    min: shownAs(setting, minimum ?? -Infinity),
    max: shownAs(setting, maximum ?? Infinity),
    step: type === "integer" ? 1 : "any",
    required: !isOptional(setting),
    placeholder: isOptional(setting) ? (off?.label ?? t("off")) : undefined,
  });
}

/**
 * @param {Setting} setting
 * @param {HTMLInputElement} input
 * @returns {number | null} NaN where it is wanted and not there
 */
function numberIn(setting, input) {
  if (!input.value && isOptional(setting)) return setting.off?.value ?? null;
  return setting.unit === "fraction" ? input.valueAsNumber / 100 : input.valueAsNumber;
}

/** @param {Setting} setting */
const isOptional = (setting) => setting.off !== null || setting.default === null;

/** Fractions are shown as percentages. @param {Setting} setting @param {number} value */
const shownAs = ({ unit }, value) => (unit === "fraction" ? Number((value * 100).toPrecision(12)) : value);
