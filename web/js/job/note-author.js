/** The name under which notes are written: the user's, or on a farm without logins one that is typed once and remembered. */

import { h } from "../base/dom.js";
import { session } from "../news/session.js";
import { t } from "../base/words.js";

const KEY = "rayfarm.author";
const LONGEST = 60;

/** @returns {string} the remembered name; empty: none */
function stored() {
  try {
    return localStorage.getItem(KEY) ?? "";
  } catch {
    return ""; // storage is blocked
  }
}

/** @param {string} name */
function store(name) {
  try {
    localStorage.setItem(KEY, name);
  } catch {
    // Storage is blocked: it stays for this page.
  }
}

/**
 * @returns {{element: HTMLElement, show: () => void, author: () => {author?: string} | null, given: () => {author?: string}}}
 *   show: shows the name's field, which is hidden at first. author: a request's field; null: the name is missing, and its field now
 *   has the focus. given: the field if there is a name
 */
export function noteAuthor() {
  const input = h("input", { type: "text", id: "note-author", maxLength: LONGEST, autocomplete: "name", value: stored() });
  const problem = h("p", { class: "problem", role: "alert", id: "note-author-problem", hidden: true }, t("Notes are signed: enter your name."));
  input.setAttribute("aria-describedby", problem.id);
  input.addEventListener("input", () => (problem.hidden = true));
  const element = h("div", { class: "field" }, h("label", { for: "note-author" }, t("Your name")), input, problem);
  element.hidden = true;
  return {
    element,
    show() {
      element.hidden = session.value.kind !== "open";
    },
    author() {
      if (session.value.kind !== "open") return {};
      const name = input.value.trim();
      if (!name) {
        element.hidden = false;
        problem.hidden = false;
        input.focus();
        return null;
      }
      store(name);
      return { author: name };
    },
    given() {
      const name = input.value.trim();
      if (session.value.kind !== "open" || !name) return {};
      store(name);
      return { author: name };
    },
  };
}
