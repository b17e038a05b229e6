/** The tray at the lower right: uploads under way, what went wrong, what can be undone. */

import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

const tray = /** @type {HTMLElement} */ (document.getElementById("tray"));
const announcer = /** @type {HTMLElement} */ (document.getElementById("announcer"));

/**
 * Tells screen readers, and only them.
 *
 * @param {string} sentence
 */
export function announce(sentence) {
  announcer.textContent = "";
  requestAnimationFrame(() => (announcer.textContent = sentence));
}

/** A card in the tray. */
export class Card {
  /** @param {string} title */
  constructor(title) {
    this.title = h("span", { class: "title", title }, title);
    /** Stands in for an icon. */
    this.lead = h("span", { hidden: true });
    this.actions = h("span", { class: "row" });
    this.body = h("div", null);
    this.element = h(
      "section",
      { "aria-label": title },
      h("header", null, this.lead, this.title, this.actions),
      this.body,
    );
    tray.append(this.element);
  }

  /** @param {() => void} run */
  onClose(run) {
    fill(
      this.actions,
      h("button", { class: "icon-button", type: "button", "aria-label": t("Dismiss"), onclick: run }, icon("close")),
    );
  }

  remove() {
    this.element.remove();
  }
}

/** More than these are a wall, and whoever comes back to it needs the latest. */
const MOST_ERRORS = 3;
const BRIEF_S = 6;

/** @typedef {{key: string, card: Card, times: number, ofPage: boolean}} Entry */

/** The errors that are shown, the oldest first. @type {Entry[]} */
const errors = [];

/** @param {Entry | undefined} entry */
function dismiss(entry) {
  if (!entry || !errors.includes(entry)) return;
  errors.splice(errors.indexOf(entry), 1);
  entry.card.remove();
}

/** Takes away what was about the page that is left. */
export function clearPageErrors() {
  for (const entry of errors.filter(({ ofPage }) => ofPage)) dismiss(entry);
}

/**
 * A sentence about what went wrong. It stays until it is dismissed: it asks for something to be done. The same sentence again
 * is counted, not repeated.
 *
 * @param {string} title
 * @param {unknown} error
 * @param {{remedy?: string, action?: {label: string, run: () => void}, ofPage?: boolean, brief?: boolean}} [help] what to do
 *   about it. ofPage: it means nothing on other pages. brief: it goes away by itself
 */
export function showError(title, error, { remedy, action, ofPage = false, brief = false } = {}) {
  const sentence = error instanceof Error ? error.message : String(error);
  const key = `${title}\n${sentence}`;
  const same = errors.find((each) => each.key === key);
  if (same) {
    same.times += 1;
    same.card.title.textContent = t("{title} ({times} times)", { title, times: same.times });
    return;
  }
  const card = new Card(title);
  const entry = { key, card, times: 1, ofPage };
  errors.push(entry);
  if (errors.length > MOST_ERRORS) dismiss(errors[0]);
  if (brief) setTimeout(() => dismiss(entry), BRIEF_S * 1000);
  card.element.className = "error";
  card.element.setAttribute("role", "alert");
  card.lead.replaceWith(icon("warning"));
  fill(card.body, h("p", { class: "detail" }, sentence), remedy && h("p", { class: "detail" }, remedy));
  if (action) {
    const act = () => {
      dismiss(entry);
      action.run();
    };
    card.body.append(
      h("p", { class: "detail" }, h("button", { class: "text-button", type: "button", onclick: act }, action.label)),
    );
  }
  card.onClose(() => dismiss(entry));
}

/**
 * A deed that waits a few seconds, so that it can be taken back.
 *
 * @param {string} sentence
 * @param {{commit: () => void, undo: () => void, seconds?: number}} deed
 */
export function undoable(sentence, { commit, undo, seconds = 7 }) {
  const card = new Card(sentence);
  announce(t("{sentence}. Press Undo to take it back.", { sentence }));
  let settled = false;
  /** @param {() => void} act */
  const settle = (act) => {
    if (settled) return;
    settled = true;
    clearTimeout(timer);
    removeEventListener("pagehide", onLeave);
    card.remove();
    act();
  };
  const onLeave = () => settle(commit);
  const timer = setTimeout(() => settle(commit), seconds * 1000);
  addEventListener("pagehide", onLeave);
  fill(card.actions, h("button", { class: "text-button", type: "button", onclick: () => settle(undo) }, t("Undo")));
}
