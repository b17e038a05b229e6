/** The language menu; a change reloads the page. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { LANGUAGES, language, speak, t } from "../base/words.js";

export function languageMenu() {
  const menu = h(
    "select",
    { "aria-label": t("Language"), title: t("Language") },
    LANGUAGES.map(([name, own]) => h("option", { value: name, lang: name, selected: name === language }, own)),
  );
  menu.addEventListener("change", () => speak(/** @type {import("../base/words.js").Language} */ (menu.value)));
  return h("label", { class: "icon-button language", title: t("Language") }, icon("globe"), menu);
}
