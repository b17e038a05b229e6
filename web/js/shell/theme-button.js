/** The theme: a button that goes through the themes, and what the palette offers. */

import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { announce } from "./tray.js";
import { t } from "../base/words.js";

/** @typedef {"system" | "light" | "dark"} Theme */

export const THEMES = /** @type {const} */ ([
  ["system", "auto", t("Theme: as the system")],
  ["light", "sun", t("Theme: light")],
  ["dark", "moon", t("Theme: dark")],
]);

/** @returns {{get: () => Theme, set: (theme: Theme) => void}} of theme.js */
const theme = () => /** @type {any} */ (window).rayfarmTheme;
/** Shows the theme on the button. */
let show = () => {};

/** @param {Theme} name */
export function chooseTheme(name) {
  theme().set(name);
  show();
  announce(THEMES.find(([each]) => each === name)?.[2] ?? "");
}

/** @returns {HTMLElement} */
export function themeButton() {
  const button = h("button", { class: "icon-button", type: "button" });
  show = () => {
    const [, symbol, label] = THEMES.find(([name]) => name === theme().get()) ?? THEMES[0];
    fill(button, icon(symbol));
    button.setAttribute("aria-label", label);
    button.title = label;
  };
  button.addEventListener("click", () => {
    const at = THEMES.findIndex(([name]) => name === theme().get());
    chooseTheme((THEMES[(at + 1) % THEMES.length] ?? THEMES[0])[0]);
  });
  show();
  return button;
}
