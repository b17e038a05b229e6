/** Bookmarked views stored in this browser: a button for each, and one that adds the current view. */

import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { viewFromText, viewToText } from "./view-url.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {{name: string, view: string}} Bookmark */

const MOST = 24;

/**
 * @param {string} scene
 * @param {() => View} view
 * @param {(view: View) => void} turn
 */
export function bookmarks(scene, view, turn) {
  const key = `rayfarm.views.${scene}`;
  let kept = read(key);
  const keep = () => {
    const taken = new Set(kept.map(({ name }) => name));
    const named = (/** @type {number} */ n) => t("View {n}", { n });
    let number = kept.length + 1;
    while (taken.has(named(number))) number += 1;
    kept = [...kept, { name: named(number), view: viewToText(view()) }].slice(-MOST);
    write();
  };
  const write = () => {
    try {
      localStorage.setItem(key, JSON.stringify(kept));
    } catch {
      // Storage is full or blocked: the bookmarks last until the page is closed.
    }
    show();
  };
  const element = h("div", { class: "bookmarks", role: "group", "aria-label": t("Views of your own") });
  const show = () =>
    fill(
      element,
      kept.map((bookmark) =>
        h(
          "span",
          { class: "bookmark" },
          h(
            "button",
            {
              class: "chip-button",
              type: "button",
              onclick: () => {
                const found = viewFromText(bookmark.view);
                if (found) turn(found);
              },
            },
            bookmark.name,
          ),
          h(
            "button",
            {
              class: "chip-button drop",
              type: "button",
              "aria-label": t("Forget {name}", { name: bookmark.name }),
              onclick: () => {
                kept = kept.filter((other) => other !== bookmark);
                write();
              },
            },
            icon("close"),
          ),
        ),
      ),
      h("button", { class: "chip-button", type: "button", title: t("Keep this view"), onclick: keep }, icon("keep"), t("Keep view")),
    );
  show();
  return element;
}

/** @param {string} key @returns {Bookmark[]} */
function read(key) {
  try {
    const found = JSON.parse(localStorage.getItem(key) ?? "[]");
    return Array.isArray(found) ? found.filter((each) => typeof each?.name === "string" && viewFromText(each.view)) : [];
  } catch {
    return [];
  }
}
