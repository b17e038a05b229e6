/** A note in the list: its place, author and text, the replies to it, and what can be done with it. */

import { fill, h, setText } from "../base/dom.js";
import { ago } from "../base/format.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Note} Note */
/** @typedef {{note: Note, number: number, replies: Note[], isCurrent: boolean}} Thread */

/**
 * @typedef {object} Deeds
 * @property {(note: Note) => void} choose shows its place
 * @property {(note: Note, text: string) => Promise<boolean>} reply returns whether it was saved
 * @property {(note: Note, resolved: boolean) => void} resolve
 * @property {(note: Note) => void} remove
 */

export const LONGEST_NOTE = 2000;

/** @param {Note} note @param {boolean} isShot @returns {string} */
export const placeName = (note, isShot) => [isShot && t("Frame {n}", { n: note.frame }), note.x === null && t("whole picture")].filter(Boolean).join(", ");

/** @param {Note} note its author and age */
const signature = ({ author, guest, created }) => [
  h("strong", null, author),
  guest && h("span", { class: "quiet" }, t("guest")),
  h("time", { class: "quiet", dateTime: new Date(created * 1000).toISOString(), title: new Date(created * 1000).toLocaleString() }, ago(created)),
];

/**
 * @param {Thread} first
 * @param {boolean} isShot
 * @param {Deeds} deeds
 * @returns {import("../base/dom.js").Row<Thread>}
 */
export function noteThread(first, isShot, deeds) {
  let { note } = first;
  const badge = h("button", { class: "note-number", type: "button", onclick: () => deeds.choose(note) });
  const place = h("span", { class: "quiet small" });
  const text = h("p", { class: "note-text" });
  const done = h("p", { class: "quiet small" });
  const answers = h("ul", { class: "note-replies" });
  const area = h("textarea", { rows: 2, maxLength: LONGEST_NOTE });
  const send = h("button", { class: "button small", type: "submit" }, t("Reply"));
  const form = h("form", { class: "stack tight", hidden: true }, area, h("div", { class: "row wraps" }, send, h("button", { class: "text-button small", type: "button", onclick: () => write(false) }, t("Cancel"))));
  const answer = h("button", { class: "text-button small", type: "button", onclick: () => write(true) }, t("Reply"));
  const resolve = h("button", { class: "text-button small", type: "button", onclick: () => deeds.resolve(note, note.resolved === null) });
  const bin = h("button", { class: "icon-button danger", type: "button", "aria-label": t("Delete the note"), title: t("Delete the note"), onclick: () => deeds.remove(note) }, icon("trash"));
  const tools = h("div", { class: "row for-submit" }, answer, resolve, h("span", { class: "grow" }), bin);
  const head = h("div", { class: "note-head" });
  const element = h("li", { class: "note-thread" }, head, text, answers, done, tools, form);
  const write = (/** @type {boolean} */ on) => {
    form.hidden = !on;
    tools.hidden = on;
    (on ? area : answer).focus();
  };
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    if (!area.value.trim()) return area.focus();
    send.disabled = true;
    if (await deeds.reply(note, area.value)) {
      area.value = "";
      write(false);
    }
    send.disabled = false;
  });
  area.addEventListener("keydown", (event) => submitOrCancel(event, form, () => write(false)));
  return {
    element,
    update({ note: next, number, replies, isCurrent }) {
      note = next;
      element.classList.toggle("current", isCurrent);
      setText(badge, number);
      badge.setAttribute("aria-label", t("Note {n}: show its place", { n: number }));
      area.setAttribute("aria-label", t("Reply to note {n}", { n: number }));
      if (!head.firstChild) fill(head, badge, signature(note), h("span", { class: "grow" }), place);
      setText(place, placeName(note, isShot));
      setText(text, note.text);
      answers.hidden = replies.length === 0;
      if (answers.childElementCount !== replies.length) {
        fill(answers, replies.map((reply) => h("li", null, h("div", { class: "note-head" }, signature(reply)), h("p", { class: "note-text" }, reply.text))));
      }
      done.hidden = note.resolved === null;
      setText(done, t("Resolved by {name}", { name: note.resolved_guest ? `${note.resolved_by} (${t("guest")})` : (note.resolved_by ?? "") }));
      setText(resolve, note.resolved === null ? t("Resolve") : t("Open again"));
    },
  };
}

/**
 * Ctrl-Enter sends a form, Escape cancels it.
 *
 * @param {KeyboardEvent} event
 * @param {HTMLFormElement} form
 * @param {() => void} cancel
 */
export function submitOrCancel(event, form, cancel) {
  if (event.key === "Escape") cancel();
  else if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) form.requestSubmit();
  else return;
  event.preventDefault();
  event.stopPropagation();
}
