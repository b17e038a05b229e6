/**
 * The tray at the lower edge: errors, and actions that can be undone; and the place of uploads: their progress, errors and questions,
 * in the front page's drop area, or over the view of a scene (css/shell.css).
 */

import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { addShortcuts } from "./shortcuts.js";

const tray = /** @type {HTMLElement} */ (document.getElementById("tray"));
const announcer = /** @type {HTMLElement} */ (document.getElementById("announcer"));
const uploadPlace = /** @type {HTMLElement} */ (document.getElementById("upload-place"));

/**
 * Shows uploads in an element of the open view.
 *
 * @param {HTMLElement} element
 * @returns {() => void} ends it
 */
export function placeUploads(element) {
  const next = uploadPlace.nextElementSibling;
  element.append(uploadPlace);
  return () => document.body.insertBefore(uploadPlace, next);
}

/**
 * Announces a sentence to screen readers only.
 *
 * @param {string} sentence
 */
export function announce(sentence) {
  announcer.textContent = "";
  requestAnimationFrame(() => (announcer.textContent = sentence));
}

/** A card in the tray, or in the place of uploads. */
export class Card {
  /** @param {string} title @param {{ofUpload?: boolean}} [place] */
  constructor(title, { ofUpload = false } = {}) {
    this.title = h("span", { class: "title", title }, title);
    /** Replaces an icon. */
    this.lead = h("span", { hidden: true });
    this.actions = h("span", { class: "row" });
    this.body = h("div", null);
    this.element = h(
      "section",
      { "aria-label": title },
      h("header", null, this.lead, this.title, this.actions),
      this.body,
    );
    (ofUpload ? uploadPlace : tray).append(this.element);
  }

  /** @param {() => void} run */
  onClose(run) {
    fill(
      this.actions,
      h("button", { class: "icon-button", type: "button", "aria-label": t("Dismiss"), onclick: run }, icon("close")),
    );
  }

  remove() {
    const hadFocus = this.element.contains(document.activeElement);
    this.element.remove();
    if (hadFocus) document.getElementById("main")?.focus({ preventScroll: true });
  }
}

/** Only the latest few errors are useful at a glance. */
const MOST_ERRORS = 3;
const BRIEF_S = 6;

/** Says for a few seconds that something was done. @param {string} sentence */
export function showBriefly(sentence) {
  announce(sentence);
  const card = new Card(sentence);
  card.lead.replaceWith(icon("check"));
  setTimeout(() => card.remove(), BRIEF_S * 1000);
}

/** @typedef {{key: string, card: Card, times: number, ofPage: boolean, close: () => void}} Entry */

/** The errors shown, oldest first. @type {Entry[]} */
const errors = [];

/** @param {Entry} entry */
function dismiss(entry) {
  if (!errors.includes(entry)) return;
  errors.splice(errors.indexOf(entry), 1);
  entry.card.remove();
}

/** Removes the errors of the page that was left. */
export function clearPageErrors() {
  for (const { close } of errors.filter(({ ofPage }) => ofPage)) close();
  clearUploadNotices();
}

/** Notices about an upload that are shown, oldest first. @type {Set<() => void>} */
const uploadNotices = new Set();

/** Removes the notices about earlier uploads; uploads in progress stay. */
export function clearUploadNotices() {
  for (const close of [...uploadNotices]) close();
}

/** Lets Escape, the next upload and another page close a notice about an upload. @param {() => void} close @returns {() => void} closes it */
function closable(close) {
  const end = () => {
    uploadNotices.delete(end);
    endKey();
    close();
  };
  const endKey = addShortcuts([{ keys: "Escape", shown: null, does: t("Dismiss"), run: end }]);
  uploadNotices.add(end);
  return end;
}

/**
 * Shows an error, which stays until it is dismissed. A repeated error is counted instead of shown again.
 *
 * @param {string} title
 * @param {unknown} error
 * @param {{remedy?: string, action?: {label: string, run: () => void}, ofPage?: boolean, brief?: boolean, ofUpload?: boolean}} [help] what to do
 *   about it. ofPage: it means nothing on other pages. brief: it goes away by itself. ofUpload: in the place of uploads, until the next one
 */
export function showError(title, error, { remedy, action, ofPage = false, brief = false, ofUpload = false } = {}) {
  const sentence = error instanceof Error ? error.message : String(error);
  const key = `${title}\n${sentence}`;
  const same = errors.find((each) => each.key === key);
  if (same) {
    same.times += 1;
    same.card.title.textContent = t("{title} ({times} times)", { title, times: same.times });
    return;
  }
  if (ofUpload) clearUploadNotices();
  const card = new Card(title, { ofUpload });
  const entry = { key, card, times: 1, ofPage, close: () => dismiss(entry) };
  const close = (entry.close = ofUpload ? closable(entry.close) : entry.close);
  errors.push(entry);
  if (errors.length > MOST_ERRORS) errors[0]?.close();
  if (brief) setTimeout(close, BRIEF_S * 1000);
  card.element.className = "error";
  card.element.setAttribute("role", "alert");
  card.lead.replaceWith(icon("warning"));
  fill(card.body, h("p", { class: "detail" }, sentence), remedy && h("p", { class: "detail" }, remedy));
  if (action) {
    const act = () => {
      close();
      action.run();
    };
    card.body.append(
      h("p", { class: "detail" }, h("button", { class: "text-button", type: "button", onclick: act }, action.label)),
    );
  }
  card.onClose(close);
}

/**
 * A notification with actions; it stays until one is used, or it is dismissed.
 *
 * @param {string} sentence
 * @param {{label: string, run: () => void}[]} actions
 * @returns {() => void} removes it
 */
export function showActionNotice(sentence, ...actions) {
  const card = new Card(sentence);
  offer(card, () => card.remove(), sentence, actions);
  return () => card.remove();
}

/**
 * A notice about what was dropped, with what can be done with it.
 *
 * @param {string} sentence
 * @param {{label: string, run: () => void}[]} actions
 */
export function showUploadNotice(sentence, ...actions) {
  clearUploadNotices();
  const card = new Card(sentence, { ofUpload: true });
  card.lead.replaceWith(icon("image"));
  offer(card, closable(() => card.remove()), sentence, actions);
}

/** @param {Card} card @param {() => void} close @param {string} sentence @param {{label: string, run: () => void}[]} actions */
function offer(card, close, sentence, actions) {
  announce(sentence);
  card.onClose(close);
  const follow = (/** @type {() => void} */ run) => {
    close();
    run();
  };
  const buttons = actions.map(({ label, run }) => h("button", { class: "text-button", type: "button", onclick: () => follow(run) }, label));
  fill(card.body, h("div", { class: "row wraps detail" }, buttons)); // below the sentence, which needs the card's width
}

/** Actions that can still be undone, latest last. @type {(() => void)[]} */
const pending = [];

/** Undoes the latest action, if its time has not expired. */
export function undoLast() {
  const undo = pending.at(-1);
  if (undo) undo();
  else announce(t("Nothing to undo"));
}

/**
 * Delays an action by a few seconds, so that it can be undone; longer while its card is hovered or has focus.
 *
 * @param {string} sentence
 * @param {{commit: () => void, undo: () => void, seconds?: number}} deed
 */
export function undoable(sentence, { commit, undo, seconds = 7 }) {
  const card = new Card(sentence);
  announce(t("{sentence}. Press Undo or Z to undo it.", { sentence }));
  let settled = false;
  /** @param {() => void} act */
  const settle = (act) => {
    if (settled) return;
    settled = true;
    clearTimeout(timer);
    pending.splice(pending.indexOf(takeBack), 1);
    removeEventListener("pagehide", onLeave);
    card.remove();
    act();
  };
  const onLeave = () => settle(commit);
  const takeBack = () => {
    settle(undo);
    announce(t("Undone"));
  };
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const run = () => {
    clearTimeout(timer);
    timer = setTimeout(() => settle(commit), seconds * 1000);
  };
  const { element } = card;
  for (const [come, go] of /** @type {const} */ ([["pointerenter", "pointerleave"], ["focusin", "focusout"]])) {
    element.addEventListener(come, () => clearTimeout(timer));
    element.addEventListener(go, () => !settled && run());
  }
  run();
  pending.push(takeBack);
  addEventListener("pagehide", onLeave);
  fill(card.actions, h("button", { class: "text-button", type: "button", title: t("Undo (Z)"), onclick: takeBack }, t("Undo")));
}
