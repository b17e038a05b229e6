/** The `?` dialog: documentation, version, and the keyboard shortcuts of the current view. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { table } from "../news/settings-table.js";
import { setLetterShortcuts, hasLetterShortcuts, shortcuts } from "./shortcuts.js";
import { language, t } from "../base/words.js";

/** The guide to begin with, in the page's language where it is translated. */
export const FIRST_STEPS = `docs/guides/first-steps${language === "de" ? ".de" : ""}`;

/** Names of keys in the language of the page. @type {Record<string, string>} */
const KEY_NAMES = { Ctrl: t("Ctrl"), Delete: t("Del"), Enter: t("Enter"), Escape: t("Esc"), Shift: t("Shift"), Space: t("Space") };

/** The groups of shortcuts, in order. @type {[import("./shortcuts.js").Group, string][]} */
const GROUPS = [["view", t("View")], ["picture", t("Picture")], ["page", t("Page")]];

/** Opens the dialog. Escape, its button or a click outside closes it. */
export function showHelp() {
  const close = h(
    "button",
    { class: "icon-button", type: "button", "aria-label": t("Close"), onclick: () => dialog.close() },
    icon("close"),
  );
  const letters = h("input", { type: "checkbox", checked: hasLetterShortcuts(), onchange: () => setLetterShortcuts(letters.checked) });
  const listed = shortcuts().filter(({ keys, shown }) => keys && shown !== null);
  const dialog = h(
    "dialog",
    {
      class: "help",
      "aria-labelledby": "help-title",
      onclick: (/** @type {MouseEvent} */ e) => e.target === dialog && dialog.close(),
      onclose: () => dialog.remove(),
    },
    h(
      "div",
      { class: "help-body" },
      h("header", null, h("h2", { id: "help-title" }, t("Help")), close),
      h(
        "p",
        { class: "row wraps help-links" },
        h("a", { href: FIRST_STEPS }, t("First steps")),
        h("a", { href: "docs/guides/" }, t("Guides")),
        h("a", { href: "docs/" }, t("API documentation")),
        table.value?.version && h("span", { class: "quiet number" }, `Rayfarm ${table.value.version}`),
      ),
      h("div", { class: "key-groups" }, GROUPS.map(([group, label]) => keyList(label, listed.filter((each) => each.group === group)))),
      gestureHelp().map((sentence) => h("p", { class: "quiet" }, sentence)),
      h("label", { class: "check" }, letters, t("Single-letter shortcuts (turn off if you dictate)")),
    ),
  );
  document.body.append(dialog);
  dialog.showModal();
}

/** Returns the shortcuts of a group under its name; null if there are none. @param {string} label @param {import("./shortcuts.js").Shortcut[]} keys */
function keyList(label, keys) {
  if (keys.length === 0) return null;
  const names = (/** @type {string} */ text) => text.split(/\+(?=.)/).map((key) => h("kbd", null, KEY_NAMES[key] ?? key));
  const rows = keys.map(({ keys, shown, does }) => h("div", null, h("dt", null, names(shown ?? keys)), h("dd", null, does)));
  return h("section", { "aria-label": label }, h("h3", null, label), h("dl", { class: "keys" }, rows));
}

/** Lists mouse and touch gestures of the current view. */
function gestureHelp() {
  /** @type {[string, string][]} */
  const sentences = [
    [".live-view", t("On the view: drag to turn, Shift and drag to move, wheel or pinch to go nearer, double-click to turn about what lies there.")],
    [".stage", t("On the picture: drag to pan, wheel or pinch to zoom, double-click to fit.")],
  ];
  return sentences.filter(([place]) => document.querySelector(place)?.checkVisibility()).map(([, sentence]) => sentence);
}
