/** Notes on the picture of a share link that allows them: pins, the list with replies, the verdict, and forms. */

import { h } from "/js/base/dom.js";
import { filled, moment, words } from "./words.js";

const KEY = "rayfarm-guest";
const LONGEST = 2000;
const LONGEST_NAME = 60;
const STEP = 0.01;
const SHORT = 80;

/** @param {string} label @param {() => void} run @param {Record<string, any>} [props] */
const button = (label, run, props = {}) => h("button", { type: "button", class: "button", onclick: run, ...props }, label);

/**
 * Ctrl-Enter in a text sends its form, Escape cancels it.
 *
 * @param {HTMLElement} area
 * @param {HTMLFormElement} form
 * @param {() => void} cancel
 */
function sendsOrCancels(area, form, cancel) {
  area.addEventListener("keydown", (event) => {
    if (event.key === "Escape") cancel();
    else if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) form.requestSubmit();
  });
}

/** The guest's name of an earlier visit; empty: none. */
function storedName() {
  try {
    return localStorage.getItem(KEY) ?? "";
  } catch {
    return ""; // storage is blocked
  }
}

/**
 * @param {(path: string, options?: {method: string, body: unknown}) => Promise<Response>} ask
 * @param {{picture: HTMLImageElement, frame: () => number, frames: () => number[], show: (frame: number) => void}} stage
 */
export function notesPanel(ask, { picture, frame, frames, show: showFrame }) {
  const layer = document.getElementById("pins");
  const panel = document.getElementById("notes");
  let notes = [];
  let current = null;
  /** The place of the new note; null: the whole picture. */
  let spot = null;
  let draft = null;

  const name = h("input", { id: "guest", type: "text", maxlength: LONGEST_NAME, autocomplete: "name" });
  name.value = storedName();
  const error = h("p", { class: "error", role: "alert", hidden: true });
  const verdicts = [
    ["approved", words.approve],
    ["changes-requested", words.change],
  ].map(([state, label]) => button(label, () => judge(state), { "aria-pressed": "false", "data-state": state }));
  const verdict = h("p", { class: "quiet", role: "status" });
  const add = button(words.add, () => write());
  const area = h("textarea", { rows: 3, maxlength: LONGEST, "aria-label": words.text });
  const hint = h("p", { class: "quiet" });
  const place = button(words.pin, () => (setSpot(spot ?? { x: 0.5, y: 0.5 }), draft.focus()));
  const form = h("form", { hidden: true }, area, hint, h("div", { class: "row" }, h("button", { class: "button primary" }, words.saveNote), place, button(words.cancel, () => close())));
  sendsOrCancels(area, form, () => close(true));
  const none = h("p", { class: "quiet" }, words.noNotes);
  const list = h("ol");
  const done = h("ol");
  const summary = h("summary");
  const fold = h("details", { hidden: true }, summary, done);
  panel.append(
    h("div", { class: "row" }, h("h2", null, words.notes), add),
    h("label", { class: "field" }, words.name, name),
    h("div", { class: "row" }, ...verdicts),
    ...[verdict, error, form, none, list, fold],
  );

  /** Lays the pins over the picture, which is fitted to the stage. */
  const align = () => {
    const [box, around] = [picture.getBoundingClientRect(), layer.parentElement.getBoundingClientRect()];
    Object.assign(layer.style, { left: `${box.left - around.left}px`, top: `${box.top - around.top}px`, width: `${box.width}px`, height: `${box.height}px` });
  };
  new ResizeObserver(align).observe(picture);
  new ResizeObserver(align).observe(layer.parentElement);
  picture.addEventListener("load", align);

  const fail = (text) => {
    error.textContent = text;
    error.hidden = !text;
  };
  /** Sends a change under the guest's name. Returns whether it was saved. */
  const send = async (method, path, body) => {
    const author = name.value.trim();
    if (!author) {
      fail(words["note-author-missing"]);
      name.focus();
      return false;
    }
    try {
      localStorage.setItem(KEY, author);
    } catch {
      // Storage is blocked: the name stays for this page.
    }
    try {
      const answer = await ask(path, { method, body: { ...body, author } });
      if (!answer.ok) {
        const problem = await answer.json();
        fail(filled(words[problem.code] ?? problem.detail ?? words.failedToSave, problem.params ?? {}));
        return false;
      }
      fail("");
      await load();
      return true;
    } catch {
      fail(words.failedToSave);
      return false;
    }
  };

  const judge = async (state) => {
    const isOn = verdicts.find((each) => each.dataset.state === state).getAttribute("aria-pressed") === "true";
    if (await send("PUT", "/api/shared/review", { state: isOn ? null : state })) void asked();
  };

  const setSpot = (next) => {
    spot = next;
    hint.textContent = next ? words.pinned : words.whole;
    draft?.remove();
    draft = null;
    if (!next) return;
    draft = h("button", { class: "pin draft", type: "button", "aria-label": words.draft, onclick: () => area.focus() }, "+");
    put(draft, next);
    draft.addEventListener("keydown", (event) => {
      const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] ?? [0, 0];
      if (!dx && !dy) return;
      event.preventDefault();
      spot = { x: Math.min(Math.max(spot.x + dx * STEP, 0), 1), y: Math.min(Math.max(spot.y + dy * STEP, 0), 1) };
      put(draft, spot);
    });
    layer.append(draft);
  };
  const put = (pin, { x, y }) => Object.assign(pin.style, { left: `${100 * x}%`, top: `${100 * y}%` });

  const write = () => {
    form.hidden = false;
    add.hidden = true;
    layer.parentElement.classList.add("placing");
    setSpot(null);
    draw();
    area.focus();
  };
  const close = (isKept = false) => {
    form.hidden = true;
    add.hidden = false;
    if (!isKept) area.value = ""; // Escape keeps the text for the next time
    layer.parentElement.classList.remove("placing");
    setSpot(null);
    draw();
    add.focus();
  };
  form.addEventListener("submit", async (event) => {
    event.preventDefault();
    if (!area.value.trim()) return area.focus();
    if (await send("POST", "/api/shared/notes", { text: area.value, frame: frame(), ...(spot ?? {}) })) close();
  });
  picture.addEventListener("click", (event) => {
    if (form.hidden) return;
    const box = picture.getBoundingClientRect();
    setSpot({ x: Math.min(Math.max((event.clientX - box.left) / box.width, 0), 1), y: Math.min(Math.max((event.clientY - box.top) / box.height, 0), 1) });
    area.focus();
  });

  const choose = (note, byPin = false) => {
    current = note.id;
    if (note.frame !== frame()) showFrame(note.frame);
    if (note.resolved !== null) fold.open = true;
    draw();
    const row = panel.querySelector(".current");
    row?.scrollIntoView({ block: "nearest" });
    if (byPin) row?.querySelector("button")?.focus({ preventScroll: true });
  };

  const signature = (note) => [
    h("strong", null, note.author),
    note.guest && h("span", { class: "quiet" }, words.guest),
    h("time", { class: "quiet", datetime: new Date(note.created * 1000).toISOString() }, moment(note.created)),
  ];

  /** Rows by the note's id; a row that is being answered stays as it is. */
  const rows = new Map();
  const rowOf = (note, number, replies) => {
    const area = h("textarea", { rows: 2, maxlength: LONGEST, "aria-label": `${words.reply} ${number}` });
    const answer = h("form", { hidden: true }, area, h("div", { class: "row" }, h("button", { class: "button" }, words.reply), button(words.cancel, () => (answer.hidden = true))));
    sendsOrCancels(area, answer, () => (answer.hidden = true));
    answer.addEventListener("submit", async (event) => {
      event.preventDefault();
      if (!area.value.trim()) return area.focus();
      if (await send("POST", "/api/shared/notes", { text: area.value, reply_to: note.id })) {
        rows.delete(note.id);
        draw();
      }
    });
    return h(
      "li",
      null,
      h(
        "div",
        { class: "head" },
        h("button", { class: `pin${note.resolved === null ? "" : " done"}`, type: "button", "aria-label": filled(words.place, { n: number }), onclick: () => choose(note) }, String(number)),
        ...signature(note),
        frames().length > 1 && h("span", { class: "quiet" }, `${words.frame} ${note.frame}`),
      ),
      h("p", { class: "text" }, note.text),
      ...replies.map((reply) => h("div", { class: "answer" }, h("div", { class: "head" }, ...signature(reply)), h("p", { class: "text" }, reply.text))),
      note.resolved !== null && h("p", { class: "quiet" }, filled(words.by, { name: note.resolved_guest ? `${note.resolved_by} (${words.guest})` : note.resolved_by })),
      h(
        "div",
        { class: "row" },
        button(words.reply, () => ((answer.hidden = false), area.focus())),
        button(note.resolved === null ? words.resolve : words.reopen, () => void send("PATCH", `/api/shared/notes/${note.id}`, { resolved: note.resolved === null })),
      ),
      answer,
    );
  };

  const draw = () => {
    const threads = notes.filter(({ reply_to }) => reply_to === null).map((note, i) => ({ note, number: i + 1, replies: notes.filter(({ reply_to }) => reply_to === note.id) }));
    for (const { note, number, replies } of threads) {
      const state = JSON.stringify([note.resolved, number, replies.length]);
      const known = rows.get(note.id);
      const isAnswered = known?.element.querySelector("form:not([hidden])");
      if (!known || (known.state !== state && !isAnswered)) rows.set(note.id, { state, element: rowOf(note, number, replies) });
    }
    const shown = (isDone) => threads.filter(({ note }) => (note.resolved !== null) === isDone);
    for (const [place, isDone] of [[list, false], [done, true]]) {
      const wanted = shown(isDone).map(({ note }) => rows.get(note.id).element);
      if (wanted.length !== place.childElementCount || wanted.some((element, i) => place.children[i] !== element)) place.replaceChildren(...wanted);
    }
    for (const { note } of threads) rows.get(note.id).element.classList.toggle("current", note.id === current);
    none.hidden = threads.length > 0 || !form.hidden;
    fold.hidden = shown(true).length === 0;
    summary.textContent = `${words.resolved} (${shown(true).length})`;
    const here = threads.filter(({ note }) => note.x !== null && note.frame === frame() && (note.resolved === null || note.id === current));
    const focused = [...layer.querySelectorAll(".pin:not(.draft)")].findIndex((pin) => pin === document.activeElement);
    const pins = here.map(({ note, number }) => {
      const text = note.text.length > SHORT ? `${note.text.slice(0, SHORT)}…` : note.text;
      const label = filled(words.pinOf, { n: number, name: note.author, text });
      const pin = h("button", { class: `pin${note.resolved === null ? "" : " done"}`, type: "button", "aria-label": label, title: label, "aria-pressed": note.id === current ? "true" : "false", onclick: () => choose(note, true) }, String(number));
      put(pin, note);
      return pin;
    });
    layer.replaceChildren(...pins, ...(draft ? [draft] : []));
    if (focused >= 0) pins[focused]?.focus({ preventScroll: true });
  };

  const load = async () => {
    const answer = await ask("/api/shared/notes?limit=1000");
    if (!answer.ok) throw new Error(String(answer.status));
    notes = await answer.json();
    draw();
  };

  let known = 0;
  let asked = async () => {};
  return {
    /** Draws the pins of the frame that is shown. */
    draw,
    /** @param {() => Promise<void>} refresh fetches the job again */
    onVerdict: (refresh) => (asked = refresh),
    /** @param {Record<string, any> | null} review of the job, as the service describes it */
    async update(review) {
      for (const each of verdicts) each.setAttribute("aria-pressed", String(each.dataset.state === review?.state));
      verdict.textContent = review?.state ? `${filled(words[review.state], { name: review.guest ? `${review.by} (${words.guest})` : review.by })} · ${moment(review.at)}` : "";
      if (review && review.changed !== known) {
        await load();
        known = review.changed;
      }
    },
  };
}
