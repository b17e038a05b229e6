/** A button that shows a scene from its other side, where the file does not state which side is its front. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */

/** Returns a camera turned by 180 degrees about the vertical line through its target. @param {View} view @returns {View} */
export function oppositeOf(view) {
  const { eye, target, up } = view;
  const away = /** @type {Vec3} */ (eye.map((value, i) => value - (target[i] ?? 0)));
  const dot = (/** @type {readonly number[]} */ a, /** @type {readonly number[]} */ b) => a.reduce((sum, value, i) => sum + value * (b[i] ?? 0), 0);
  const height = (2 * dot(away, up)) / dot(up, up);
  return { ...view, eye: /** @type {Vec3} */ (target.map((value, i) => value - (away[i] ?? 0) + height * (up[i] ?? 0))) };
}

/**
 * @param {import("../base/types.js").Scene} scene
 * @param {object} view
 * @param {() => View} view.view the present camera
 * @param {(view: View) => void} view.turn
 * @returns {{element: HTMLElement, update: () => void}} update: the camera may have changed
 */
export function otherSide(scene, { view, turn }) {
  const whole = scene.cameras.at(-1)?.view;
  const isFrontUnknown = scene.up_axis != null && scene.cameras.length === 1; // the file states neither directions nor a camera
  const both = isFrontUnknown && whole ? [whole, oppositeOf(whole)] : [];
  const at = () => both.findIndex((each) => each.eye.every((value, i) => Math.abs(value - (view().eye[i] ?? 0)) < 1e-6 * (1 + Math.abs(value))));
  const flip = () => {
    const other = both[at() === 0 ? 1 : 0];
    if (other) turn(other);
  };
  const element = h("button", { class: "button small view-frame", type: "button", title: t("The file does not state its front: see the scene from its other side"), "aria-label": t("Other side"), hidden: true, onclick: flip }, icon("turn"), h("span", null, t("Other side")));
  return {
    element,
    update() {
      element.hidden = at() < 0;
    },
  };
}
