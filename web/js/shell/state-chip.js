/** A state as an icon and a word; the colour is redundant. */

import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/** @type {Record<string, [import("../base/icons.js").IconName, string]>} */
const STATES = {
  preparing: ["clock", t("Preparing")],
  ready: ["check", t("Ready")],
  queued: ["clock", t("Queued")],
  running: ["play", t("Rendering")],
  paused: ["pause", t("Paused")],
  finishing: ["clock", t("Finishing")],
  finished: ["check", t("Finished")],
  failed: ["warning", t("Failed")],
  cancelled: ["stop", t("Cancelled")],
  starting: ["clock", t("Starting")],
  draining: ["clock", t("Draining")],
  resting: ["clock", t("Inactive")],
  "set-aside": ["warning", t("Quarantined")],
};

/** @param {string} state */
export const stateWord = (state) => STATES[state]?.[1] ?? state;

/**
 * @param {string} state
 * @returns {{element: HTMLElement, update: (state: string) => void}}
 */
export function stateChip(state) {
  const element = h("span", { class: "chip" });
  let shown = "";
  /** @param {string} next */
  const update = (next) => {
    if (next === shown) return;
    shown = next;
    const [symbol, word] = STATES[next] ?? ["info", next];
    element.className = `chip ${next}`;
    fill(element, icon(symbol), h("span", null, word));
  };
  update(state);
  return { element, update };
}

/**
 * @param {string} label for screen readers
 * @returns {{element: HTMLElement, update: (fraction: number | null, state?: string) => void}} null: under way, no telling how far
 */
export function progressBar(label) {
  const bar = h("div");
  const element = h(
    "div",
    { class: "progress", role: "progressbar", "aria-label": label, "aria-valuemin": "0", "aria-valuemax": "100" },
    bar,
  );
  return {
    element,
    update(reached, state = "") {
      const fraction = state === "finished" ? 1 : reached; // also by its noise or time, with fewer samples than at most
      element.className = `progress ${state} ${fraction === null ? "unknown" : ""}`;
      bar.style.transform = fraction === null ? "" : `scaleX(${fraction})`;
      if (fraction === null) element.removeAttribute("aria-valuenow");
      else element.setAttribute("aria-valuenow", String(Math.floor(fraction * 100)));
    },
  };
}
