/** The theme button of the guides and of the API's page, as the farm's page has it. */

import { icon } from "/js/base/icons.js";

const THEMES = /** @type {const} */ ([
  ["system", "auto", "Theme: as the system"],
  ["light", "sun", "Theme: light"],
  ["dark", "moon", "Theme: dark"],
]);

/** Adds a button that goes through the themes; the choice is shared with the farm's page. */
export function addThemeMenu() {
  const theme = /** @type {any} */ (window).rayfarmTheme;
  if (!theme) return;
  const button = Object.assign(document.createElement("button"), { type: "button", className: "theme" });
  const show = () => {
    const [, symbol, label] = THEMES.find(([name]) => name === theme.get()) ?? THEMES[0];
    button.replaceChildren(icon(symbol));
    button.ariaLabel = button.title = label;
  };
  button.addEventListener("click", () => {
    const at = THEMES.findIndex(([name]) => name === theme.get());
    theme.set((THEMES[(at + 1) % THEMES.length] ?? THEMES[0])[0]);
    show();
  });
  show();
  document.querySelector(".top")?.append(button);
}
