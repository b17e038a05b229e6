/** The verdict on a job's pictures: approved, or changes requested, with who and when. */

import { h, setText } from "../base/dom.js";
import { ago } from "../base/format.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Review} Review */

/** @param {Review | null | undefined} review @returns {string} who gave which verdict; empty: none */
export function verdictWords(review) {
  if (!review?.state) return "";
  const name = review.guest ? t("{name} (guest)", { name: review.by ?? "" }) : (review.by ?? "");
  return review.state === "approved" ? t("Approved by {name}", { name }) : t("Changes requested by {name}", { name });
}

/** The verdict beside the job's state. @returns {{element: HTMLElement, update: (review: Review | null | undefined) => void}} */
export function verdictChip() {
  const element = h("span", { class: "chip verdict", hidden: true });
  /** @type {Review["state"]} */
  let shown = null;
  return {
    element,
    update(review) {
      const state = review?.state ?? null;
      element.title = verdictWords(review);
      if (state === shown) return;
      shown = state;
      element.hidden = !state;
      element.className = `chip verdict ${state ?? ""}`;
      element.replaceChildren(icon(state === "approved" ? "check" : "pencil"), state === "approved" ? t("Approved") : t("Changes requested"));
    },
  };
}

/** @param {(state: Review["state"]) => void} choose */
export function verdictPanel(choose) {
  /** @type {Review["state"]} */
  let now = null;
  const button = (/** @type {"approved" | "changes-requested"} */ state, /** @type {import("../base/icons.js").IconName} */ sign, /** @type {string} */ label) =>
    h("button", { class: "button small", type: "button", "aria-pressed": "false", onclick: () => choose(now === state ? null : state) }, icon(sign), label);
  const buttons = { approved: button("approved", "check", t("Approve")), "changes-requested": button("changes-requested", "pencil", t("Ask for changes")) };
  const words = h("p", { class: "quiet small", role: "status" });
  return {
    element: h("div", { class: "stack tight" }, h("div", { class: "verdict-buttons for-submit" }, Object.values(buttons)), words),
    /** @param {Review | null | undefined} review */
    update(review) {
      now = review?.state ?? null;
      for (const [state, element] of Object.entries(buttons)) element.setAttribute("aria-pressed", String(state === now));
      words.hidden = !now;
      setText(words, now ? `${verdictWords(review)} · ${ago(review?.at ?? 0)}` : "");
    },
  };
}
