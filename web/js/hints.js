/** Empty states and standing hints: each says what to do next. */

import { h } from "./dom.js";
import { icon } from "./icons.js";
import { announce } from "./tray.js";

/**
 * A shell command with a button that copies it.
 *
 * @param {string} text
 */
export function command(text) {
  const button = h(
    "button",
    {
      class: "icon-button",
      type: "button",
      "aria-label": "Copy the command",
      onclick: async () => {
        await navigator.clipboard.writeText(text);
        announce("Copied");
        button.replaceChildren(icon("check"));
        setTimeout(() => button.replaceChildren(icon("copy")), 1500);
      },
    },
    icon("copy"),
  );
  button.hidden = !navigator.clipboard; // only on HTTPS and localhost
  return h("div", { class: "command" }, h("code", null, text), button);
}

export const joinCommand = () => `rayfarm worker --join ${location.origin}`;

/** Shown wherever work waits for a worker. */
export function noWorkerNotice() {
  return h(
    "div",
    { class: "notice warning", role: "status" },
    icon("warning"),
    h(
      "div",
      { class: "grow" },
      h("strong", null, "No worker is connected. "),
      "What you start waits until there is one. Start one on this or another machine:",
      command(joinCommand()),
    ),
  );
}

/**
 * @param {import("./icons.js").IconName} symbol
 * @param {string} title
 * @param {...import("./dom.js").Child} children
 */
export function emptyState(symbol, title, ...children) {
  return h("div", { class: "empty" }, icon(symbol), h("strong", null, title), ...children);
}
