/** The menu of themes of the guides and of the API's page. */

/** Adds a menu of the themes; the choice is shared with the farm's page. */
export function addThemeMenu() {
  const theme = /** @type {any} */ (window).rayfarmTheme;
  if (!theme) return;
  const menu = Object.assign(document.createElement("select"), { ariaLabel: "Theme", className: "theme" });
  for (const [value, text] of [["system", "System"], ["light", "Light"], ["dark", "Dark"]]) {
    menu.append(Object.assign(document.createElement("option"), { value, textContent: text, selected: value === theme.get() }));
  }
  menu.addEventListener("change", () => theme.set(menu.value));
  document.querySelector(".top")?.append(menu);
}
