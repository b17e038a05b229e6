/** What is said over a picture that has nothing to show yet: why, and that no worker is there. */

import { fill, h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { said } from "../base/said.js";
import { t } from "../base/words.js";
import { workers } from "../news/farm.js";
import { noWorkerNotice } from "../shell/hints.js";

/** @typedef {import("../base/types.js").Job} Job */

const ENDED = ["cancelled", "failed"];
const OVER = ["finished", ...ENDED];

/**
 * @param {HTMLElement} stage where they are put
 * @param {() => Job} job the latest state
 * @param {import("../base/store.js").Disposer} life
 * @returns {{update: () => void}}
 */
export function stageNotices(stage, job, life) {
  const notice = h("div", { class: "stage-notice" });
  const why = h("span");
  const waiting = h("p", { class: "stage-waiting", "aria-hidden": "true", hidden: true }, icon("info"), why); // its panel says the same
  stage.append(notice, waiting);
  life.add(workers.subscribe((all) => fill(notice, all?.length === 0 && !OVER.includes(job().state) && noWorkerNotice())));
  const update = () => {
    const { state, samples, message } = job();
    waiting.hidden = samples > 0 || !(state === "queued" || ENDED.includes(state));
    setText(why, ENDED.includes(state) ? t("Nothing was rendered.") : said(message) || t("Waits for its first samples."));
  };
  update();
  return { update };
}
