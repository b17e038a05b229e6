/** A camera by numbers: where it is, what it looks at, which way is up, how wide it sees. */

import { h } from "./dom.js";
import { field, numberInput, numberOf } from "./fields.js";

/** @typedef {import("./types.js").View} View */
/** @typedef {import("./types.js").Vec3} Vec3 */

const START = /** @type {View} */ ({ eye: [0, 0, 5], target: [0, 0, 0], up: [0, 1, 0], fov: 40 });

/**
 * @param {View} [start]
 * @returns {{element: HTMLElement, get: () => View, set: (view: View) => void}}
 */
export function viewFields(start = START) {
  const eye = vector("Eye");
  const target = vector("Target");
  const up = vector("Up");
  const fov = numberInput({ min: 0.01, max: 179, step: "any" });
  /** @param {View} view */
  const set = (view) => {
    eye.set(view.eye);
    target.set(view.target);
    up.set(view.up);
    fov.value = String(short(view.fov));
  };
  set(start);
  return {
    element: h(
      "div",
      { class: "stack" },
      eye.element,
      target.element,
      up.element,
      field("Vertical field of view, degrees", fov),
    ),
    get: () => ({ eye: eye.get(), target: target.get(), up: up.get(), fov: numberOf(fov, START.fov) }),
    set,
  };
}

/** @param {string} label */
function vector(label) {
  const inputs = ["x", "y", "z"].map((axis) => numberInput({ step: "any", label: `${label} ${axis}` }));
  return {
    element: h(
      "div",
      { class: "field", role: "group", "aria-label": label },
      h("span", { class: "label" }, label),
      h("div", { class: "triple" }, inputs),
    ),
    /** @returns {Vec3} */
    get: () => /** @type {Vec3} */ (inputs.map((input) => numberOf(input, 0))),
    /** @param {Vec3} value */
    set: (value) => inputs.forEach((input, i) => (input.value = String(short(value[i] ?? 0)))),
  };
}

/** Six digits place a camera to a pixel; seventeen fill the field. @param {number} value */
function short(value) {
  return Number(value.toPrecision(6));
}
