/** The name and the description of a job (its `note` in the API), both searchable in the list. */

import { change } from "./job-panel.js";
import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { mayChange } from "../news/projects.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

const LONGEST_NAME = 200;
const LONGEST_NOTE = 2000;

/**
 * The page's title, editable by a pencil or F2. Enter and leaving the field store the text, Escape restores it; an empty name
 * resets to the scene's.
 *
 * @returns {{element: HTMLElement, keys: import("../shell/shortcuts.js").Shortcut[], update: (job: Job) => void}}
 */
export function jobTitle() {
  /** @type {Job | null} */
  let latest = null;
  const heading = h("h1", null);
  const pencil = h("button", { class: "icon-button for-submit rename", type: "button", "aria-label": t("Rename"), title: t("Rename (F2)"), onclick: () => begin() }, icon("pencil"));
  const input = h("input", { type: "text", maxLength: LONGEST_NAME, "aria-label": t("Name of the picture"), spellcheck: "false", autocomplete: "off" });
  const element = h("div", { class: "job-title" }, heading, pencil);
  const begin = () => {
    if (!latest || input.isConnected || !mayChange(latest.project)) return;
    input.value = latest.name;
    heading.classList.add("visually-hidden"); // remains the page's heading
    element.replaceChildren(heading, input);
    input.focus();
    input.select();
  };
  /** @param {boolean} isKept */
  const end = (isKept) => {
    if (!input.isConnected) return;
    const name = input.value.trim();
    const hadFocus = document.activeElement === input;
    heading.classList.remove("visually-hidden");
    element.replaceChildren(heading, pencil);
    if (hadFocus) pencil.focus();
    if (isKept && latest && name !== latest.name) void change(latest, { name }, t("The job was not renamed"));
  };
  input.addEventListener("keydown", (event) => {
    if (event.key !== "Enter" && event.key !== "Escape") return;
    event.preventDefault();
    event.stopPropagation(); // both keys have page-wide meanings too
    end(event.key === "Enter");
  });
  input.addEventListener("blur", () => end(true));
  return {
    element,
    keys: [{ keys: "F2", does: t("Rename"), run: begin }],
    update(job) {
      latest = job;
      setText(heading, job.name);
      heading.title = job.name;
    },
  };
}

/** @returns {{element: HTMLElement, update: (job: Job) => void}} */
export function notePanel() {
  /** @type {Job | null} */
  let latest = null;
  const add = h("button", { class: "text-button small", type: "button", onclick: () => begin() }, t("Add a description"));
  const text = h("p", { class: "note-text" });
  const pencil = h("button", { class: "icon-button for-submit", type: "button", "aria-label": t("Change the description"), title: t("Change the description"), onclick: () => begin() }, icon("pencil"));
  const shown = h("div", { class: "row spread start" }, text, pencil);
  const area = h("textarea", { id: "job-note", maxLength: LONGEST_NOTE, rows: 3 });
  const form = h(
    "form",
    { class: "stack tight", hidden: true },
    h("label", { for: "job-note" }, t("Description")),
    area,
    h("div", { class: "row" }, h("button", { class: "button small", type: "submit" }, t("Save")), h("button", { class: "text-button small", type: "button", onclick: () => end(false) }, t("Cancel"))),
  );
  const element = h("div", { class: "note" }, add, shown, form);
  const show = () => {
    const isWriting = !form.hidden;
    const note = latest?.note ?? "";
    setText(text, note);
    add.hidden = isWriting || note !== "";
    shown.hidden = isWriting || note === "";
    element.hidden = !isWriting && note === "" && !mayChange(latest?.project);
  };
  const begin = () => {
    area.value = latest?.note ?? "";
    form.hidden = false;
    show();
    area.focus();
  };
  /** @param {boolean} isKept */
  const end = (isKept) => {
    const note = area.value.trim();
    form.hidden = true;
    if (isKept && latest && note !== (latest.note ?? "")) {
      void change(latest, { note }, t("The description was not saved"));
      latest = { ...latest, note: note || null }; // shown at once, then replaced by the service's answer
    }
    show();
    (add.hidden ? pencil : add).focus();
  };
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    end(true);
  });
  area.addEventListener("keydown", (event) => {
    if (event.key === "Escape") end(false);
    else if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) end(true);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  return {
    element,
    update(job) {
      latest = job;
      show();
    },
  };
}
