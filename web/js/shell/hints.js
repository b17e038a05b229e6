/** Empty states and permanent hints, each with the next step. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { may } from "../news/session.js";
import { linkTo } from "./router.js";
import { announce } from "./tray.js";
import { t } from "../base/words.js";

/**
 * A shell command, or another line to copy, with a copy button.
 *
 * @param {string} text
 * @param {string} [label] of the button
 */
export function command(text, label = t("Copy the command")) {
  const code = h("code", null, text.split(/(?<=\s)/).map((word) => h("span", { class: "word" }, word))); // a line ends between options
  const button = h(
    "button",
    {
      class: "icon-button",
      type: "button",
      "aria-label": label,
      onclick: async () => {
        await copy(code);
        announce(t("Copied"));
        button.replaceChildren(icon("check"));
        setTimeout(() => button.replaceChildren(icon("copy")), 1500);
      },
    },
    icon("copy"),
  );
  return h("div", { class: "command" }, code, button);
}

/** Copies an element's text. @param {HTMLElement} element */
async function copy(element) {
  try {
    await navigator.clipboard.writeText(element.textContent ?? "");
  } catch {
    // Plain HTTP, where browsers have no clipboard API, or it is forbidden. What is selected can also be copied by hand.
    getSelection()?.selectAllChildren(element);
    document.execCommand("copy");
  }
}

/** A notice shown wherever work waits for a worker. */
export function noWorkerNotice() {
  return h(
    "div",
    { class: "notice warning no-worker", role: "status" },
    icon("warning"),
    h(
      "div",
      { class: "grow" },
      h("strong", null, t("No worker is connected. ")),
      t("Jobs wait until there is one."),
      " ",
      may("admin") ? h("a", { href: linkTo("workers") }, t("Add a machine")) : t("An administrator can add one."),
    ),
  );
}

/**
 * @param {import("../base/icons.js").IconName} symbol
 * @param {string} title
 * @param {...import("../base/dom.js").Child} children
 */
export function emptyState(symbol, title, ...children) {
  return h("div", { class: "empty" }, icon(symbol), h("strong", null, title), ...children);
}

/**
 * An empty state that fills the page; its title is the page's.
 *
 * @param {import("../base/icons.js").IconName} symbol
 * @param {string} title
 * @param {...import("../base/dom.js").Child} children
 */
export function emptyPage(symbol, title, ...children) {
  return h("div", { class: "empty" }, icon(symbol), h("h1", null, title), ...children);
}
