/** Framing of the whole scene: by a key, and by a button where the camera shows it small. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { undoable } from "../shell/tray.js";
import { shareInView } from "./in-view.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */

/** Share of the picture that the outline of a small scene's bounds has at most: of that, most shapes cover about half. */
const SMALL = 0.12;
/** The same, of what the outline covers when the scene is framed: a slender one is never large. */
const SMALL_OF_FRAMED = 0.5;

/**
 * @param {import("../base/types.js").Scene} scene
 * @param {object} view
 * @param {() => View} view.view the present camera
 * @param {() => number} view.aspect width of its picture by its height
 * @param {() => [Vec3, Vec3] | null} view.bounds of the scene as it is shown; null: not known
 * @param {(view: View) => void} view.turn
 * @returns {{element: HTMLElement, frame: () => void, update: () => void, dispose: () => void}} update: the camera may have changed
 */
export function frameHand(scene, { view, aspect, bounds, turn }) {
  const frame = () => {
    const before = view();
    const whole = scene.cameras.at(-1)?.view; // the automatic camera is the last one
    if (!whole || JSON.stringify(whole) === JSON.stringify(before)) return;
    turn(whole);
    undoable(t("The whole scene is framed"), { commit: () => {}, undo: () => turn(before) });
  };
  const element = h("button", { class: "button small view-frame", type: "button", title: t("Frame the scene (F)"), "aria-label": t("Frame the scene"), hidden: true, onclick: frame }, icon("fit"), h("span", null, t("Frame the scene")));
  const endKey = addShortcuts([{ keys: "F", does: t("Frame the scene"), run: frame }], "view");
  return {
    element,
    frame,
    update() {
      const box = bounds();
      const whole = scene.cameras.at(-1)?.view;
      const most = box && whole && Math.min(SMALL, SMALL_OF_FRAMED * shareInView(whole, aspect(), ...box));
      element.hidden = !box || !most || shareInView(view(), aspect(), ...box) >= most;
    },
    dispose: endKey,
  };
}
