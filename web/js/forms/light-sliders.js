/** A slider beside a number of the light: strength in stops, a turn in degrees. */

import { h } from "../base/dom.js";
import { numberOf } from "./fields.js";

const STOPS = 4;

/**
 * @param {import("./setting-field.js").SettingField} field
 * @returns {HTMLElement} its element, with the slider in it
 */
export function withSlider({ setting, element }) {
  const input = /** @type {HTMLInputElement} */ (element.querySelector("input"));
  const isTurn = setting.unit === "°";
  const slider = h("input", {
    type: "range",
    class: "centred",
    min: isTurn ? "-180" : String(-STOPS),
    max: isTurn ? "180" : String(STOPS),
    step: isTurn ? "1" : "0.05",
    "aria-label": `${setting.label}, slider`,
  });
  const follow = () => {
    const value = numberOf(input, setting.default);
    slider.value = String(isTurn ? value : value > 0 ? Math.log2(value) : -STOPS);
  };
  slider.addEventListener("input", () => {
    const at = slider.valueAsNumber;
    input.value = String(isTurn ? at : Number((2 ** at).toPrecision(2)));
  });
  input.addEventListener("input", follow);
  follow();
  input.before(slider);
  element.classList.add("with-slider");
  return element;
}
