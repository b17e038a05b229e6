/** Selected jobs of a list, and the bar with actions on all of them. */

import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { announce } from "../shell/tray.js";
import { linkTo } from "../shell/router.js";
import { JOB_ACTIONS, change, remove } from "./job-deeds.js";
import { grouped, t, tn } from "../base/words.js";

/** The selected ids of a list. */
export class Selection {
  /** @param {() => void} changed */
  constructor(changed) {
    this.changed = changed;
    /** @type {Set<string>} */
    this.chosen = new Set();
    /** @type {string[]} */
    this.ids = [];
    /** Start of a range. @type {string | null} */
    this.anchor = null;
  }

  /** Deselects ids that are no longer listed. @param {string[]} ids */
  among(ids) {
    this.ids = ids;
    if (this.chosen.size === 0) return;
    const there = new Set(ids);
    for (const id of this.chosen) if (!there.has(id)) this.chosen.delete(id);
  }

  /** @param {string} id */
  has(id) {
    return this.chosen.has(id);
  }

  /**
   * @param {string} id
   * @param {boolean} range from where the last one was picked
   * @param {boolean} adds whether to extend the selection
   */
  pick(id, range, adds) {
    const from = this.anchor === null ? -1 : this.ids.indexOf(this.anchor);
    const to = this.ids.indexOf(id);
    if (range && from >= 0) {
      if (!adds) this.chosen.clear();
      for (const each of this.ids.slice(Math.min(from, to), Math.max(from, to) + 1)) this.chosen.add(each);
    } else {
      if (this.chosen.has(id)) this.chosen.delete(id);
      else this.chosen.add(id);
      this.anchor = id;
    }
    this.tell();
  }

  toggleFocused() {
    const box = document.activeElement?.closest(".job-row")?.querySelector("[data-job]");
    const id = box?.getAttribute("data-job");
    if (id) this.pick(id, false, true);
  }

  all() {
    this.chosen = new Set(this.ids);
    this.tell();
  }

  clear() {
    if (this.chosen.size === 0) return;
    this.chosen.clear();
    this.anchor = null;
    this.tell();
  }

  tell() {
    announce(this.chosen.size ? tn(this.chosen.size, "{n} job selected", "{n} jobs selected") : t("Nothing selected"));
    this.changed();
  }
}

/** States of jobs with a place in the queue. */
const OPEN = ["queued", "running", "paused"];

/**
 * A bar with the actions that apply to at least one of the selected jobs; to two pictures, also their comparison.
 *
 * @param {Selection} selection
 * @param {(id: string) => import("../base/types.js").Job | undefined} jobOf undefined: not loaded, as jobs outside the window may be
 * @returns {{element: HTMLElement, update: () => void, remove: () => void}}
 */
export function selectionBar(selection, jobOf) {
  const number = h("strong", { class: "number" });
  const ids = () => [...selection.chosen];
  const removeAll = () => {
    const gone = ids();
    if (gone.length === 0) return;
    selection.clear();
    remove(gone);
  };
  const priority = h("input", { type: "number", min: "-100", max: "100", step: "1", value: "0", "aria-label": t("Priority, -100 to 100; higher is sooner") });
  const prioritise = () => {
    if (priority.reportValidity() && priority.value !== "")
      void change(ids(), { priority: Number(priority.value) }, t("set to priority {n}", { n: Number(priority.value) }));
  };
  const all = h("button", { class: "text-button", type: "button", onclick: () => selection.all() }, t("Select all"));
  const compare = h("a", { class: "button small" }, icon("compare"), t("Compare"));
  const deeds = JOB_ACTIONS.map((deed) => ({
    of: deed.change.of ?? [],
    button: h(
      "button",
      { class: "button small for-submit", type: "button", onclick: () => void change(ids(), deed.change, deed.done) },
      icon(deed.icon),
      deed.label,
    ),
  }));
  const queue = h(
    "form",
    { class: "priority for-submit", onsubmit: (/** @type {Event} */ event) => (event.preventDefault(), prioritise()) },
    priority,
    h("button", { class: "button small", type: "submit" }, t("Set priority")),
  );
  const element = h(
    "div",
    { class: "selection-bar", role: "toolbar", "aria-label": t("Selected jobs"), hidden: true },
    number,
    compare,
    deeds.map(({ button }) => button),
    queue,
    h("button", { class: "button small danger for-submit", type: "button", onclick: removeAll }, icon("trash"), t("Delete")),
    h("span", { class: "grow" }),
    all,
    h(
      "button",
      { class: "icon-button", type: "button", "aria-label": t("Select none"), title: t("Select none (Esc)"), onclick: () => selection.clear() },
      icon("close"),
    ),
  );
  return {
    element,
    update() {
      element.hidden = selection.chosen.size === 0;
      setText(number, t("{n} selected", { n: grouped(selection.chosen.size) }));
      all.hidden = selection.chosen.size === selection.ids.length;
      const chosen = ids().map(jobOf);
      const has = (/** @type {string[]} */ states) => chosen.some((job) => !job || states.includes(job.state));
      for (const { of, button } of deeds) button.hidden = !has(of);
      queue.hidden = !has(OPEN);
      const [a, b] = selection.ids.filter((id) => selection.has(id)).map(jobOf); // in the order of the list
      compare.hidden = chosen.length !== 2 || ![a, b].every((job) => job?.width && job.samples > 0);
      if (a && b) compare.href = linkTo("compare", a.id, b.id);
    },
    remove: removeAll,
  };
}
