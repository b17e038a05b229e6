/** Building blocks of the account page's sections. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { command } from "../shell/hints.js";
import { showError } from "../shell/tray.js";

/** Roles with descriptions. @type {[import("../news/access.js").Role, string][]} */
export const ROLES = [
  ["view", t("View: look")],
  ["submit", t("Submit: render too")],
  ["admin", t("Admin: workers and users too")],
];

/** @param {string} title @param {...(Node | false)} content */
export const section = (title, ...content) => h("section", { class: "section" }, h("header", null, h("h2", null, title)), ...content);

/** @param {string} id @param {string} label @param {HTMLElement} input */
export const field = (id, label, input) => {
  input.id = id;
  return h("div", { class: "field" }, h("label", { for: id }, label), input);
};

/** @param {[string, string][]} choices @param {string} chosen @param {Record<string, any>} [props] */
export const choice = (choices, chosen, props = {}) =>
  h("select", props, choices.map(([value, label]) => h("option", { value, selected: value === chosen }, label)));

/** @param {string} label @param {() => void} run */
export const removing = (label, run) => h("button", { class: "icon-button danger", type: "button", "aria-label": label, title: label, onclick: run }, icon("trash"));

/** A secret that is shown only once. @param {string} sentence @param {string} text */
export const once = (sentence, text) => h("div", { class: "told-once", role: "status" }, h("p", null, sentence), command(text));

/** @param {() => Promise<unknown>} deed */
export const tried = (deed) => void deed().catch((error) => showError(t("The change was not made"), error));

/** @param {Event} event @param {() => Promise<unknown>} deed */
export const submitted = (event, deed) => {
  event.preventDefault();
  tried(deed);
};
