/** A slider beside a number, with the usual range; the number accepts more. */

import { h } from "../base/dom.js";

/** @typedef {import("../base/types.js").Setting} Setting */

const STEPS = 400;
/** Ratio of the range from which steps are logarithmic. */
const WIDE = 16;

/**
 * Adds the slider before the number; dragging it counts as typing.
 *
 * @param {Setting} setting with a usual range
 * @param {HTMLInputElement} input in the page, in the units that are shown
 */
export function addSlider(setting, input) {
  const { type, unit, usual, off } = setting;
  if (!usual) return;
  const [low, high] = unit === "fraction" ? [usual[0] * 100, usual[1] * 100] : usual;
  // For pointers only: keyboards and screen readers use the number.
  const slider = h("input", { type: "range", min: 0, max: STEPS, step: "any", tabindex: "-1", "aria-hidden": "true" });
  const isWide = low > 0 && high / low >= WIDE;
  /** @param {number} t 0 ... 1 */
  const at = (t) => (isWide ? low * (high / low) ** t : low + (high - low) * t);
  /** @param {number} value */
  const of = (value) => (isWide ? Math.log(value / low) / Math.log(high / low) : (value - low) / (high - low));
  const show = () => {
    const value = input.value ? input.valueAsNumber : (off?.value ?? low);
    slider.value = String(STEPS * Math.min(Math.max(of(Math.max(value, low)), 0), 1));
  };
  slider.addEventListener("input", () => {
    const value = at(slider.valueAsNumber / STEPS);
    const least = Number(input.min);
    const shown = type === "integer" ? Math.round(value) : Number(value.toPrecision(3));
    input.value = off && shown < Math.max(least, (high - low) / STEPS) ? "" : String(shown);
    input.dispatchEvent(new Event("input", { bubbles: true }));
  });
  slider.addEventListener("change", () => input.dispatchEvent(new Event("change", { bubbles: true })));
  input.addEventListener("input", () => document.activeElement !== slider && show());
  input.addEventListener("change", show);
  const row = h("div", { class: "slider-row" });
  input.replaceWith(row);
  row.append(slider, input);
  show();
}
