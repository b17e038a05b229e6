/** Form fields: a label, a control, and an optional explanation below. */

import { h, setText } from "../base/dom.js";
import { t } from "../base/words.js";

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
  const element = h(
    "div",
    { class: "field" },
    h("label", { for: control.id }, label),
    control,
    hint && h("p", { class: "hint", id: hintId }, hint),
  );
  if (control instanceof HTMLInputElement && control.type === "number") explain(element, label, [control]);
  return element;
}

/** Explains a field in a tooltip, which screen readers read out with its control. @param {HTMLElement} element @param {HTMLElement} control @param {string} help */
export function setTip(element, control, help) {
  element.title = help;
  if (help) control.setAttribute("aria-description", help);
  else control.removeAttribute("aria-description");
}

/**
 * Shows validation errors below the fields instead of the browser's bubble, until they are fixed.
 *
 * @param {HTMLElement} element
 * @param {string} label
 * @param {HTMLInputElement[]} inputs
 */
export function explain(element, label, inputs) {
  const problem = h("p", { class: "problem", role: "alert", hidden: true });
  element.append(problem);
  const show = () => {
    const wrong = inputs.find((input) => !input.validity.valid);
    problem.hidden = wrong === undefined;
    setText(problem, wrong ? problemOf(wrong, label) : "");
    for (const input of inputs) input.setAttribute("aria-invalid", String(!input.validity.valid));
  };
  for (const input of inputs) {
    input.addEventListener("invalid", (event) => (event.preventDefault(), show()));
    input.addEventListener("change", show);
    input.addEventListener("input", () => !problem.hidden && show());
  }
}

/** @param {HTMLInputElement} input @param {string} label @returns {string} a sentence */
function problemOf({ type, validity, validationMessage, min, max }, label) {
  if (validity.customError) return validationMessage;
  if (validity.badInput && type === "datetime-local") return t("{label} needs a day and a time.", { label });
  if (validity.badInput) return t("{label}: this is not a number.", { label });
  if (validity.valueMissing) return t("{label} needs a number.", { label });
  if (validity.stepMismatch) return t("{label} is a whole number.", { label });
  // Very large technical maximums are not shown.
  return Number(max) < 1e6 ? t("{label} lies between {min} and {max}.", { label, min, max }) : t("{label} is at least {min}.", { label, min });
}

/**
 * Hides and disables a field, since a hidden invalid field would block the form.
 *
 * @param {HTMLElement} element
 * @param {boolean} shown
 */
export function setShown(element, shown) {
  element.hidden = !shown;
  for (const input of element.querySelectorAll("input")) input.disabled = !shown;
}

/**
 * A choice with an explanation of the selected option as its tooltip.
 *
 * @param {string} label
 * @param {import("../base/types.js").Choice[]} choices
 * @param {string} start
 * @param {() => void} [changed] by the user
 */
export function choiceField(label, choices, start, changed) {
  const select = h(
    "select",
    null,
    choices.map(({ name, label }) => h("option", { value: name }, label)),
  );
  const element = field(label, select);
  const show = () => setTip(element, select, choices.find(({ name }) => name === select.value)?.help ?? "");
  select.addEventListener("change", () => (show(), changed?.()));
  /** @param {string} value */
  const set = (value) => {
    select.value = value;
    show();
  };
  set(start);
  return { element, get: () => select.value, set };
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
 * A few exclusive options side by side. `aside` is at the right of the label and shows the effect of the choice.
 *
 * @param {string} label
 * @param {{value: string, label: string | HTMLElement}[]} options
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

/** Focuses the input after a choice by pointer; keyboard focus stays among the options. @param {HTMLInputElement} input */
export function typeNext(input) {
  if (!document.activeElement?.matches(":focus-visible")) input.focus();
}

/** @param {HTMLInputElement} input @param {number} fallback */
export function numberOf(input, fallback) {
  return Number.isFinite(input.valueAsNumber) ? input.valueAsNumber : fallback;
}
