/** The user's limits and their use. */

import { fill, h } from "../base/dom.js";
import { bytes, compact, count } from "../base/format.js";
import { t } from "../base/words.js";
import { getQuota } from "../news/access.js";
import { showError } from "../shell/tray.js";

/** @typedef {import("../news/access.js").Amounts} Amounts */

/** @type {[keyof Amounts, string, (n: number) => string][]} */
const ROWS = [
  ["bytes", t("Uploads and films"), bytes],
  ["jobs", t("Unfinished jobs"), count],
  ["samples_day", t("Samples of the last 24 hours"), compact],
];

/** @returns {HTMLElement} hidden where there are no limits */
export function quotaSection() {
  const list = h("dl", { class: "quota" });
  const section = h("section", { class: "section", hidden: true }, h("header", null, h("h2", null, t("Limits"))), list);
  getQuota().then(
    (found) => {
      const rows = found.flatMap(({ limits, used }) =>
        ROWS.flatMap(([name, label, said]) => {
          const [limit, has] = [limits[name], used[name] ?? 0];
          return limit === null ? [] : [row(label, has, limit, said)];
        }),
      );
      section.hidden = rows.length === 0;
      fill(list, rows);
    },
    (error) => showError(t("The limits cannot be shown"), error),
  );
  return section;
}

/** @param {string} label @param {number} used @param {number} limit @param {(n: number) => string} said */
function row(label, used, limit, said) {
  const isFull = used >= limit;
  const text = t("{used} of {limit}", { used: said(used), limit: said(limit) });
  return h(
    "div",
    { class: isFull && "full" },
    h("dt", null, label),
    h("dd", { class: "number" }, isFull ? t("{text}: limit reached", { text }) : text, h("meter", { min: 0, max: Math.max(limit, 1), value: Math.min(used, limit) || (isFull ? 1 : 0), "aria-label": label })),
  );
}
