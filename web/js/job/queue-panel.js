/** A job's place among the others: what it waits for. */

import { change } from "./job-panel.js";
import { fill, h } from "../base/dom.js";
import { linkTo } from "../shell/router.js";
import { stateChip } from "../shell/state-chip.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/** @returns {{element: HTMLElement, update: (job: Job) => void}} */
export function queuePanel() {
  /** @type {Job | null} */
  let latest = null;
  const begin = () => latest && void change(latest, { after: [] }, t("The job was not changed"));
  const waits = h("ul", { class: "waits" });
  const element = h(
    "section",
    { class: "side-section queue stack tight", "aria-label": t("Waits for"), hidden: true },
    h("h2", null, t("Waits for")),
    waits,
    h("button", { class: "button small", type: "button", onclick: begin }, t("Begin without waiting")),
  );
  let shown = "";
  return {
    element,
    update(job) {
      latest = job;
      const all = job.waits_for ?? [];
      element.hidden = !all.length;
      const key = JSON.stringify(all);
      if (key === shown) return;
      shown = key;
      fill(waits, ...all.map(waitRow));
    },
  };
}

/** @param {import("../base/types.js").Wait} wait */
function waitRow({ id, name, state }) {
  const label = name ?? t("A picture");
  return h("li", null, h("a", { href: linkTo("jobs", id), title: label }, label), state && stateChip(state).element);
}
