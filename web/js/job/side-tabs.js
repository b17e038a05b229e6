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
 * @property {boolean} [isOffered] whether the list has it from the start; true where left out
 */

let chosen = "";

/**
 * @param {string} label for screen readers
 * @param {Tab[]} tabs
 * @returns {{elements: HTMLElement[], show: (name: string) => void, current: () => string, offer: (name: string, isOffered: boolean) => void}}
 *   elements: the list, and the panels; offer: adds a tab to the list, or takes it out
 */
export function sideTabs(label, tabs) {
  const stem = freshId("tab");
  const panels = tabs.map(({ name, content }) =>
    h("div", { class: "side-tab", role: "tabpanel", id: `${stem}-${name}-panel`, "aria-labelledby": `${stem}-${name}` }, content),
  );
  /** @param {number} i @param {boolean} [takesFocus] */
  const choose = (i, takesFocus = false) => {
    list.dataset.tab = tabs[i]?.name ?? "";
    buttons.forEach((button, other) => {
      button.setAttribute("aria-selected", String(other === i));
      button.tabIndex = other === i ? 0 : -1;
      /** @type {HTMLElement} */ (panels[other]).hidden = other !== i;
      tabs[other]?.shown?.(other === i);
    });
    if (takesFocus) buttons[i]?.focus();
  };
  const buttons = tabs.map(({ name, label: text, badge, isOffered }, i) =>
    h("button", { type: "button", role: "tab", id: `${stem}-${name}`, "aria-controls": `${stem}-${name}-panel`, hidden: isOffered === false, onclick: () => pick(i) }, text, badge),
  );
  const list = h("div", { class: "side-tabs", role: "tablist", "aria-label": label }, buttons);
  list.addEventListener("keydown", (event) => {
    const inList = buttons.filter((button) => !button.hidden);
    const at = inList.findIndex((button) => button === document.activeElement);
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key];
    const next = event.key === "Home" ? 0 : event.key === "End" ? inList.length - 1 : step === undefined ? -1 : (at + step + inList.length) % inList.length;
    const button = inList[next];
    if (!button) return;
    event.preventDefault();
    event.stopPropagation();
    pick(buttons.indexOf(button), true);
  });
  /** Shows the wanted tab, or the first one while that is not offered. @param {boolean} [takesFocus] */
  const showChosen = (takesFocus = false) => {
    const i = tabs.findIndex(({ name }) => name === chosen);
    choose(buttons[i]?.hidden === false ? i : 0, takesFocus);
  };
  /** @param {number} i @param {boolean} [takesFocus] */
  const pick = (i, takesFocus = false) => {
    chosen = tabs[i]?.name ?? "";
    showChosen(takesFocus);
  };
  showChosen();
  return {
    elements: [list, ...panels],
    show: (name) => pick(tabs.findIndex((tab) => tab.name === name)),
    current: () => list.dataset.tab ?? "",
    offer(name, isOffered) {
      const button = buttons[tabs.findIndex((tab) => tab.name === name)];
      if (!button || button.hidden === !isOffered) return;
      button.hidden = !isOffered;
      if (name === chosen) showChosen();
    },
  };
}
