/** Empty states and permanent hints, each with the next step. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { announce } from "./tray.js";
import { t } from "../base/words.js";

/**
 * A shell command, or another line to copy, with a copy button.
 *
 * @param {string} text
 * @param {string} [label] of the button
 */
export function command(text, label = t("Copy the command")) {
  const button = h(
    "button",
    {
      class: "icon-button",
      type: "button",
      "aria-label": label,
      onclick: async () => {
        await navigator.clipboard.writeText(text);
        announce(t("Copied"));
        button.replaceChildren(icon("check"));
        setTimeout(() => button.replaceChildren(icon("copy")), 1500);
      },
    },
    icon("copy"),
  );
  button.hidden = !navigator.clipboard; // only on HTTPS and localhost
  return h("div", { class: "command" }, h("code", null, text), button);
}

/** The command that adds a worker to this farm. The token is printed where the farm was started. */
export const joinCommand = () => `RAYFARM_TOKEN=TOKEN python3 farm.py worker --join ${location.origin}`;

/** Whether this page was opened by a loopback address, which other machines cannot use. */
const isLoopback = () => ["localhost", "127.0.0.1", "[::1]"].includes(location.hostname);

/** Explains how another machine joins the farm: in its network, or over HTTPS alone. */
export function addMachineHint() {
  const [about, how] = isLoopback()
    ? [t("This farm can only be reached from its own machine. Start it like this, and it prints the command to run on others:"), "python3 farm.py up --host 0.0.0.0"]
    : [t("Run this there, in a clone of the same version. The farm printed its token when it started."), joinCommand()];
  const farm = location.protocol === "https:" ? location.origin : "https://farm.example";
  return [
    way(t("In the same network"), about ?? "", how ?? ""),
    way(
      t("Anywhere, over HTTPS"),
      t("A machine at home or in another company needs only this page's HTTPS address and a token of its own. Create the token here, copy the file, and start the worker there:"),
      "python3 farm.py token make NAME --role worker --days 0 > NAME.token",
      `python3 farm.py worker --join ${farm} --token-file NAME.token`,
    ),
  ];
}

/** @param {string} title @param {string} text @param {string[]} commands */
const way = (title, text, ...commands) =>
  h("section", { class: "stack tight", "aria-label": title }, h("h3", null, title), h("p", { class: "quiet" }, text), commands.map((each) => command(each)));

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
      t("Jobs wait until there is one. Start one:"),
      command(joinCommand()),
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
