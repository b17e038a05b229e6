/** Lists to select pictures A and B: the alternative to the strip for touch, keyboards and screen readers. */

import { fill, h } from "../base/dom.js";
import { lightWords } from "../base/light-words.js";
import { t } from "../base/words.js";
import { hidden, jobs } from "../news/farm.js";
import { reached } from "../news/settings-table.js";
import { LIVE, clean } from "./sides.js";

/** @typedef {import("../base/types.js").Job} Job */

/** @param {Job} job @returns {string} "64 samples, 960×540, Clear sky, sun at 35° elevation, 120°" */
export const wordsOf = (job) => [reached(job), `${job.width}×${job.height}`, lightWords(job.environment)].filter(Boolean).join(", ");

/**
 * @param {string} scene
 * @param {import("../base/store.js").Store<import("./sides.js").Sides>} sides
 * @returns {{a: HTMLElement, b: HTMLElement, update: () => void}}
 */
export function sideChoices(scene, sides) {
  /** @param {"a" | "b"} which @param {string} label */
  const choice = (which, label) => {
    const select = h("select", {
      "aria-label": label,
      onchange: () =>
        sides.update((now) => {
          const next = { ...now, [which]: select.value };
          if (next.a !== next.b) return next;
          return clean(which === "a" ? { a: next.a, b: now.a } : { a: now.b || LIVE, b: next.b }); // swaps them
        }),
    });
    return { select, element: h("label", { class: "side-of-view" }, h("span", { class: "letter", "aria-hidden": "true" }, which.toUpperCase()), select) };
  };
  const a = choice("a", t("Picture A"));
  const b = choice("b", t("Picture B"));
  let listed = "";
  return {
    a: a.element,
    b: b.element,
    update() {
      const own = (jobs.value ?? []).filter((job) => job.scene === scene && job.width && !hidden.value.has(job.id));
      const pictures = own.map((job) => ({ id: job.id, words: wordsOf(job) }));
      const key = JSON.stringify(pictures);
      if (key !== listed) {
        listed = key;
        const options = () => pictures.map(({ id, words }) => h("option", { value: id }, words));
        fill(a.select, h("option", { value: LIVE }, t("Live view")), options());
        fill(b.select, h("option", { value: "" }, t("Nothing")), h("option", { value: LIVE }, t("Live view")), options());
      }
      a.select.value = sides.value.a;
      b.select.value = sides.value.b;
    },
  };
}
