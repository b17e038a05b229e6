/** A button beside a field whose value differs from its default; it resets the field. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/**
 * @param {HTMLElement} element a field with a label
 * @param {HTMLInputElement | HTMLSelectElement} control
 * @param {string} own what it would show
 */
export function addReset(element, control, own) {
  const shown = own === "" && control instanceof HTMLInputElement ? control.placeholder : own;
  const button = h(
    "button",
    {
      class: "reset",
      type: "button",
      title: t("Reset to {value}", { value: textOf(control, shown) }),
      "aria-label": t("Reset to {value}", { value: textOf(control, shown) }),
      onclick() {
        control.value = own;
        for (const kind of ["input", "change"]) control.dispatchEvent(new Event(kind, { bubbles: true }));
        control.focus();
      },
    },
    icon("undo"),
  );
  const show = () => {
    button.hidden = control.value === own || Number(control.value) === Number(own || NaN);
    element.classList.toggle("changed", !button.hidden);
  };
  for (const kind of ["input", "change"]) control.addEventListener(kind, show);
  element.querySelector("label")?.after(button);
  show();
}

/** @param {HTMLInputElement | HTMLSelectElement} control @param {string} value */
function textOf(control, value) {
  if (control instanceof HTMLInputElement) return value;
  return [...control.options].find((option) => option.value === value)?.text ?? value;
}
