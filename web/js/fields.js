/** Form fields: a label, a control, and a sentence below where one helps. */

import { h } from "./dom.js";

let ids = 0;

/** @param {string} stem @returns {string} an id that nothing else on the page has */
export function freshId(stem) {
  ids += 1;
  return `${stem}-${ids}`;
}

/**
 * @param {string} label
 * @param {HTMLElement} control
 * @param {string} [hint]
 */
export function field(label, control, hint) {
  control.id ||= freshId("field");
  const hintId = `${control.id}-hint`;
  if (hint) control.setAttribute("aria-describedby", hintId);
  return h(
    "div",
    { class: "field" },
    h("label", { for: control.id }, label),
    control,
    hint && h("p", { class: "hint", id: hintId }, hint),
  );
}

/**
 * @param {{value?: number | string, min?: number, max?: number, step?: number | "any", placeholder?: string, required?: boolean, label?: string}} options
 */
export function numberInput({ value = "", min, max, step = 1, placeholder, required = true, label }) {
  return h("input", {
    type: "number",
    inputmode: step === 1 ? "numeric" : "decimal",
    autocomplete: "off",
    ...{ min, max, step, placeholder, required },
    value: String(value),
    "aria-label": label,
  });
}

/**
 * A few exclusive choices side by side. `aside` stands at the right of the label and says what the choice comes to.
 *
 * @param {string} label
 * @param {{value: string, label: string}[]} options
 * @param {(value: string) => void} changed by the user
 */
export function segments(label, options, changed) {
  const name = freshId("segments");
  const group = h("div", { class: "segments", role: "radiogroup", "aria-label": label });
  const radios = options.map(({ value, label: text }) => {
    const radio = h("input", { type: "radio", name, value, onchange: () => changed(value) });
    group.append(h("label", null, radio, text));
    return { value, radio };
  });
  /** @param {string} value */
  const select = (value) => radios.forEach((option) => (option.radio.checked = option.value === value));
  const aside = h("span", { class: "quiet small number" });
  return {
    element: h(
      "div",
      { class: "field" },
      h("div", { class: "row spread" }, h("span", { class: "label", "aria-hidden": "true" }, label), aside),
      group,
    ),
    select,
    aside,
  };
}

/** @param {HTMLInputElement} input @param {number} fallback */
export function numberOf(input, fallback) {
  return Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : fallback;
}
