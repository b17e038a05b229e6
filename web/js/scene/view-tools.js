/** Tools of the view that replace navigation: at most one is active, selected by a button or a key. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";

/**
 * @typedef {object} Tool
 * @property {string} name
 * @property {import("../base/icons.js").IconName} icon
 * @property {string} label
 * @property {string} short the label where there is little room
 * @property {string} title
 * @property {string} hint what to do with it
 * @property {(event: PointerEvent) => void} press
 * @property {(event: KeyboardEvent) => boolean} [key] whether it was the tool's
 * @property {() => boolean} [takeBack] reverts the drag in progress; false: there is none
 */

/**
 * @typedef {object} ViewTools
 * @property {Map<string, HTMLButtonElement>} buttons
 * @property {() => string} chosen "" for none
 * @property {(name: string) => void} choose "" for none
 * @property {(event: PointerEvent) => boolean} press whether it was a tool's
 * @property {(event: KeyboardEvent) => boolean} key likewise
 * @property {() => boolean} escape reverts the drag in progress, or else deselects the tool; false: neither exists
 */

/**
 * @param {HTMLElement} surface
 * @param {Tool[]} tools
 * @param {(hint: string) => void} tell "" where none is in the hand
 * @returns {ViewTools}
 */
export function viewTools(surface, tools, tell) {
  /** @type {Tool | undefined} */
  let current;
  const buttons = new Map(
    tools.map(({ name, icon: face, label, short, title }) => [
      name,
      h(
        "button",
        { ...{ class: "button small", type: "button", title, "aria-label": label, "aria-pressed": "false" }, onclick: () => choose(current?.name === name ? "" : name) },
        icon(face),
        h("span", { class: "view-word" }, short),
      ),
    ]),
  );
  /** @param {string} name */
  const choose = (name) => {
    if (name === (current?.name ?? "")) return;
    current = tools.find((tool) => tool.name === name);
    for (const [each, button] of buttons) button.setAttribute("aria-pressed", String(each === name));
    surface.dataset.tool = name;
    tell(current?.hint ?? "");
  };
  return {
    buttons,
    chosen: () => current?.name ?? "",
    choose,
    press(event) {
      // As in Substance: Shift and the right button control the light, whatever tool is active.
      const tool = event.shiftKey && event.button === 2 ? tools.find(({ name }) => name === "light") : event.button === 0 && current;
      if (!tool) return false;
      tool.press(event);
      return true;
    },
    key: (event) => current?.key?.(event) ?? false,
    escape() {
      if (tools.some(({ takeBack }) => takeBack?.())) return true;
      if (!current) return false;
      choose("");
      return true;
    },
  };
}
