/** The notice on a finished picture with samples of a distrusted worker, with a button to render those again. */

import { change } from "./job-panel.js";
import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/** @returns {{element: HTMLElement, update: (job: Job) => void}} */
export function doubtNotice() {
  /** @type {Job | null} */
  let latest = null;
  const text = h("p");
  const again = h("button", { class: "button small for-submit", type: "button" }, icon("refresh"), t("Render those again"));
  again.addEventListener("click", async () => {
    if (!latest) return;
    again.disabled = true;
    await change(latest, { state: "running" }, t("They could not be rendered again"));
    again.disabled = false;
  });
  const notice = h("div", { class: "notice warning", role: "status" }, icon("warning"), h("div", { class: "grow stack tight" }, text, again));
  const element = h("section", { class: "side-section doubt", "aria-label": t("Disputed samples"), hidden: true }, notice);
  return {
    element,
    update(job) {
      latest = job;
      const names = job.doubted ?? [];
      element.hidden = names.length === 0;
      if (names.length) setText(text, t("Some of its samples come from {names}, whose results were later found to differ from other workers'.", { names: names.join(", ") }));
    },
  };
}
