/** The notes on a job's pictures: the verdict, the list with replies, pins over the picture, and a form for a new note. */

import { h, keyedList, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { notePins } from "../film/note-pins.js";
import { drawsRegions } from "../film/region.js";
import * as api from "../news/notes.js";
import { announce, showError, undoable } from "../shell/tray.js";
import { isShot } from "../base/shot-words.js";
import { noteAuthor } from "./note-author.js";
import { LONGEST_NOTE, noteThread, submitOrCancel } from "./note-thread.js";
import { verdictPanel } from "./verdict.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").Note} Note */
/** @typedef {import("../film/note-pins.js").Spot} Spot */

const SHORT = 80;

/**
 * @param {() => Job} job
 * @param {import("../film/live-picture.js").LivePicture} picture
 * @param {import("../base/store.js").Disposer} life
 * @param {{open: () => void, begin: () => void, goTo: (frame: number) => void}} page open: shows this panel; begin: called when a note is begun,
 *   which a click on the picture pins; goTo: shows a frame of a shot
 */
export function notesPanel(job, picture, life, { open, begin, goTo }) {
  const { view, live } = picture;
  const { id } = job();
  const ofShot = isShot(job());
  /** @type {Note[]} */
  let notes = [];
  /** @type {string | null} */
  let current = null;
  /** Notes that are being deleted. @type {Set<string>} */
  const leaving = new Set();
  let isShown = false;

  const name = noteAuthor();
  const verdict = verdictPanel((state) => void judge(state));
  const add = h("button", { class: "button small for-submit", type: "button", title: t("Add a note (Shift+N)"), onclick: () => write(null) }, icon("plus"), t("Add note"));
  const area = h("textarea", { rows: 3, maxLength: LONGEST_NOTE, "aria-label": t("New note"), placeholder: t("What should change?") });
  const hint = h("p", { class: "quiet small" });
  const save = h("button", { class: "button small primary", type: "submit" }, t("Save note"));
  const pinIt = h("button", { class: "button small", type: "button", onclick: () => (setSpot(spot ?? { x: 0.5, y: 0.5 }), pins?.focusDraft()) }, icon("pin"), t("Pin"));
  const form = h("form", { class: "stack tight", hidden: true }, area, hint, h("div", { class: "row wraps" }, save, pinIt, h("button", { class: "text-button small", type: "button", onclick: () => close() }, t("Cancel"))));
  const none = h("p", { class: "quiet small" }, t("No notes yet. Press “Add note”, then click or tap the picture to pin one."));
  const list = h("ol", { class: "note-list" });
  const resolved = h("ol", { class: "note-list" });
  const summary = h("summary", null);
  const fold = h("details", { hidden: true }, summary, resolved);
  const badge = h("span", { class: "tab-count", hidden: true });
  const element = h(
    "section",
    { class: "side-section stack notes-panel", "aria-label": t("Notes") },
    h("div", { class: "row spread" }, h("h2", null, t("Notes")), add),
    verdict.element,
    ...[name.element, form, none, list, fold],
  );

  const deeds = {
    choose: (/** @type {Note} */ note) => choose(note.id),
    reply: (/** @type {Note} */ note, /** @type {string} */ text) => sent((author) => api.addNote(id, { text, reply_to: note.id, ...author }), t("The reply was not saved")),
    resolve: (/** @type {Note} */ note, /** @type {boolean} */ done) => void sent((author) => api.resolveNote(id, note.id, { resolved: done, ...author }), t("The note was not changed")),
    remove: (/** @type {Note} */ note) => {
      const hide = (/** @type {boolean} */ on) => (on ? leaving.add(note.id) : leaving.delete(note.id), show());
      hide(true);
      const commit = async () => {
        try {
          await api.deleteNote(id, note.id);
          await load();
        } catch (error) {
          showError(t("The note was not deleted"), error, { ofPage: true });
        }
        hide(false);
      };
      undoable(t("Note deleted"), { commit: () => void commit(), undo: () => hide(false) });
    },
  };
  const rows = [list, resolved].map((place) => keyedList(place, (/** @type {import("./note-thread.js").Thread} */ { note }) => note.id, (thread) => noteThread(thread, ofShot, deeds)));
  const pins = view ? notePins(view, life, (note) => choose(note, true)) : null;

  const show = () => {
    const threads = notes
      .filter(({ reply_to }) => reply_to === null)
      .map((note, i) => ({ note, number: i + 1, replies: notes.filter(({ reply_to }) => reply_to === note.id), isCurrent: note.id === current }))
      .filter(({ note }) => !leaving.has(note.id));
    const still = threads.filter(({ note }) => note.resolved === null);
    const done = threads.filter(({ note }) => note.resolved !== null);
    rows[0]?.(still);
    rows[1]?.(done);
    none.hidden = threads.length > 0 || !form.hidden;
    fold.hidden = done.length === 0;
    setText(summary, t("Resolved ({n})", { n: done.length }));
    badge.hidden = still.length === 0;
    setText(badge, still.length);
    const here = [...still, ...done.filter(({ isCurrent }) => isShown && isCurrent)].filter(({ note }) => note.x !== null && note.frame === live.frame);
    pins?.show(
      here.map(({ note, number }) => ({
        ...{ id: note.id, number, x: note.x ?? 0, y: note.y ?? 0, isDone: note.resolved !== null },
        label: t("Note {n} by {name}: {text}", { n: number, name: note.author, text: note.text.length > SHORT ? `${note.text.slice(0, SHORT)}…` : note.text }),
      })),
      isShown ? current : null,
    );
  };

  /** @param {string} which @param {boolean} [byPin] */
  const choose = (which, byPin = false) => {
    const note = notes.find((each) => each.id === which);
    if (!note) return;
    current = which;
    if (byPin) open();
    if (ofShot && note.frame !== live.frame) goTo(note.frame);
    if (note.resolved !== null) fold.open = true;
    show();
    const row = element.querySelector(".note-thread.current");
    row?.scrollIntoView({ block: "nearest" });
    if (byPin) /** @type {HTMLElement | null | undefined} */ (row?.querySelector(".note-number"))?.focus({ preventScroll: true });
  };

  let asked = 0;
  const load = async () => {
    const mine = ++asked;
    try {
      const found = await api.getNotes(id);
      if (mine !== asked) return;
      notes = found;
      show();
    } catch (error) {
      if (isShown) showError(t("The notes cannot be shown"), error, { ofPage: true });
    }
  };
  /**
   * Sends a change under the author's name, and loads the notes again.
   *
   * @param {(author: {author?: string}) => Promise<unknown>} send
   * @param {string} failure
   * @returns {Promise<boolean>} whether it was carried out
   */
  const sent = async (send, failure) => {
    const author = name.author();
    if (!author) return false;
    try {
      await send(author);
      await load();
      return true;
    } catch (error) {
      showError(failure, error, { ofPage: true });
      return false;
    }
  };
  const judge = async (/** @type {import("../base/types.js").Review["state"]} */ state) => {
    if (await sent(async (author) => verdict.update(await api.setVerdict(id, { state, ...author })), t("The verdict was not saved"))) announce(t("Verdict saved"));
  };

  /** The place of the new note; null: the whole picture. @type {Spot | null} */
  let spot = null;
  const showSpot = (/** @type {Spot | null} */ next) => {
    spot = next;
    setText(hint, next ? t("Pinned. Click or tap the picture to move the pin.") : t("Applies to the whole picture. Click or tap the picture to pin the note to a place."));
  };
  const setSpot = (/** @type {Spot | null} */ next) => {
    showSpot(next);
    pins?.setDraft(next, showSpot, () => area.focus());
  };
  const write = (/** @type {Spot | null} */ at) => {
    begin();
    form.hidden = false;
    name.show();
    add.hidden = true;
    pinIt.hidden = !view;
    view?.element.classList.add("measuring");
    setSpot(at);
    show();
    area.focus(); // a missing name is asked for when the note is saved
  };
  /** @param {boolean} [isKept] whether the text is there when the form is opened again */
  const close = (isKept = false) => {
    form.hidden = true;
    add.hidden = false;
    if (!isKept) area.value = "";
    view?.element.classList.remove("measuring");
    setSpot(null);
    pins?.setDraft(null);
    show();
    add.focus();
  };
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    const text = area.value;
    if (!text.trim()) return area.focus();
    save.disabled = true;
    const note = { text, frame: live.frame, ...(spot ?? {}) };
    if (await sent((author) => api.addNote(id, { ...note, ...author }), t("The note was not saved"))) {
      close();
      announce(t("Note saved"));
    }
    save.disabled = false;
  });
  area.addEventListener("keydown", (event) => submitOrCancel(event, form, () => close(true)));
  if (view) {
    const { width, height } = view.size;
    const chosen = (/** @type {import("../film/region.js").Rect} */ { x, y, w, h: high }) => (setSpot({ x: (x + w / 2) / width, y: (y + high / 2) / height }), area.focus());
    life.add(drawsRegions(view, { wanted: ({ shiftKey }) => !form.hidden && isShown && !shiftKey, chosen }));
    life.add(() => view.element.classList.remove("measuring"));
  }
  life.add(live.onTurn(show));

  let known = 0;
  return {
    element,
    badge,
    /** Highlights the current note, and shows the pin of a resolved one, only while the panel is shown. @param {boolean} on */
    setShown(on) {
      if (isShown === on) return;
      isShown = on;
      if (!on && !form.hidden) close(true);
      show();
    },
    /** @type {import("../shell/shortcuts.js").Shortcut[]} */
    keys: [
      {
        keys: "Shift+N",
        does: t("Note on the pixel under the cursor, or on the whole picture"),
        run: () => {
          if (add.offsetParent === null && isShown) return; // may not write, or does
          open();
          const at = view?.over.cursor;
          write(at && view ? { x: (at.x + 0.5) / view.size.width, y: (at.y + 0.5) / view.size.height } : null);
        },
      },
    ],
    /** @param {Job} next */
    update({ review }) {
      verdict.update(review);
      if (!review || review.changed === known) return;
      known = review.changed;
      void load();
    },
  };
}
