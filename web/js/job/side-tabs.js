/** Tabs of a picture's side: one panel is shown at a time. The latest choice lasts while the page is open. */

import { h } from "../base/dom.js";
import { freshId } from "../forms/fields.js";

/**
 * @typedef {object} Tab
 * @property {string} name
 * @property {string} label
 * @property {import("../base/dom.js").Child[]} content
 * @property {HTMLElement} [badge] beside the label
 * @property {(isShown: boolean) => void} [shown] called when it is shown or hidden
 */

let chosen = "";

/**
 * @param {string} label for screen readers
 * @param {(Tab | false)[]} offered false: a tab that this picture does not have
 * @returns {{elements: HTMLElement[], show: (name: string) => void, current: () => string}} elements: the list, and the panels
 */
export function sideTabs(label, offered) {
  const tabs = offered.filter((tab) => tab !== false);
  const stem = freshId("tab");
  const panels = tabs.map(({ name, content }) =>
    h("div", { class: "side-tab", role: "tabpanel", id: `${stem}-${name}-panel`, "aria-labelledby": `${stem}-${name}` }, content),
  );
  /** @param {number} i @param {boolean} [takesFocus] */
  const choose = (i, takesFocus = false) => {
    chosen = tabs[i]?.name ?? "";
    list.dataset.tab = chosen;
    buttons.forEach((button, other) => {
      button.setAttribute("aria-selected", String(other === i));
      button.tabIndex = other === i ? 0 : -1;
      /** @type {HTMLElement} */ (panels[other]).hidden = other !== i;
      tabs[other]?.shown?.(other === i);
    });
    if (takesFocus) buttons[i]?.focus();
  };
  const buttons = tabs.map(({ name, label: text, badge }, i) =>
    h("button", { type: "button", role: "tab", id: `${stem}-${name}`, "aria-controls": `${stem}-${name}-panel`, onclick: () => choose(i) }, text, badge),
  );
  const list = h("div", { class: "side-tabs", role: "tablist", "aria-label": label }, buttons);
  list.addEventListener("keydown", (event) => {
    const at = buttons.findIndex((button) => button === document.activeElement);
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const next = event.key === "Home" ? 0 : event.key === "End" ? tabs.length - 1 : step === undefined ? -1 : (at + step + tabs.length) % tabs.length;
    if (next < 0) return;
    event.preventDefault();
    event.stopPropagation();
    choose(next, true);
  });
  choose(Math.max(tabs.findIndex(({ name }) => name === chosen), 0));
  return { elements: [list, ...panels], show: (name) => choose(Math.max(tabs.findIndex((tab) => tab.name === name), 0)), current: () => list.dataset.tab ?? "" };
}
