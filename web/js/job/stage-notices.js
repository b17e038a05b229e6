/** Notices over a picture without samples: the reason, and missing workers. */

import { fill, h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { saidOf } from "../base/said.js";
import { t } from "../base/words.js";
import { changeJob } from "../news/api.js";
import { putJob, workers } from "../news/farm.js";
import { noWorkerNotice } from "../shell/hints.js";
import { showError } from "../shell/tray.js";

/** @typedef {import("../base/types.js").Job} Job */

const ENDED = ["cancelled", "failed"];
const OVER = ["finished", ...ENDED];

/**
 * @param {HTMLElement} stage where they are put
 * @param {() => Job} job the latest state
 * @param {import("../film/live-film.js").LiveFilm} live
 * @param {import("../base/store.js").Disposer} life
 * @returns {{update: () => void}}
 */
export function stageNotices(stage, job, live, life) {
  const notice = h("div", { class: "stage-notice" });
  const why = h("span");
  // its panel shows the same
  const waiting = h("p", { class: "stage-waiting", "aria-hidden": "true", hidden: true }, icon("info"), why);
  const again = async () => {
    try {
      putJob(await changeJob(job().id, { state: "running" }));
      live.missing.set("");
    } catch (error) {
      showError(t("The picture could not be rendered again"), error);
    }
  };
  const missing = h("div", { class: "stage-missing", role: "status", hidden: true });
  stage.append(notice, waiting, missing);
  const update = () => {
    const { state, samples } = job();
    // Without a worker the notice says why.
    const isOpen = state === "queued" || state === "running";
    const hasStart = live.look !== null || live.clean !== ""; // a picture that the words would cover
    waiting.hidden = samples > 0 || state === "finished" || (isOpen && hasStart) || notice.childElementCount > 0;
    setText(why, ENDED.includes(state) ? t("Nothing was rendered.") : state === "paused" ? t("Paused before its first samples.") : saidOf(job(), "message") || t("Waiting for the first samples."));
  };
  life.add(workers.subscribe((all) => (fill(notice, all?.length === 0 && !OVER.includes(job().state) && noWorkerNotice()), update())));
  life.add(
    live.missing.subscribe((sentence) => {
      missing.hidden = !sentence;
      fill(
        missing,
        sentence && h("p", null, icon("warning"), h("span", null, sentence)),
        sentence && h("button", { class: "for-submit", type: "button", onclick: again }, t("Render it again")),
      );
    }),
  );
  return { update };
}
