/** Small buttons over a view that show the scene from its sides, with their keys. */

import { h } from "../base/dom.js";
import { t } from "../base/words.js";
import { SIDES } from "../forms/side-views.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { isSameView } from "./orbit.js";

/** @typedef {import("../base/types.js").View} View */

/**
 * @param {object} of
 * @param {() => View | null} of.view the present camera; null: not known yet
 * @param {(side: string) => View | null} of.side the view from a side; null while the scene's extent is unknown
 * @param {(view: View) => void} of.turn
 * @returns {{element: HTMLElement, update: () => void, dispose: () => void}} update: the camera or the scene may have changed
 */
export function sideHand({ view, side, turn }) {
  const look = (/** @type {string} */ name) => {
    const next = side(name);
    if (next) turn(next);
  };
  const buttons = Object.entries(SIDES).map(([name, { label, short, key }]) => ({
    name,
    button: h("button", { type: "button", title: `${label} (${key})`, "aria-label": label, "aria-pressed": "false", onclick: () => look(name) }, short),
  }));
  const element = h("div", { class: "view-sides", role: "group", "aria-label": t("Sides") }, buttons.map(({ button }) => button));
  const dispose = addShortcuts(Object.entries(SIDES).map(([name, { label, key }]) => ({ keys: key, does: label, run: () => look(name) })), "view");
  return {
    element,
    update() {
      const now = view();
      for (const { name, button } of buttons) {
        const of = side(name);
        button.setAttribute("aria-pressed", String(Boolean(of && now && isSameView(of, now))));
      }
      element.hidden = !side("front");
    },
    dispose,
  };
}
