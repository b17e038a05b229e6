/** All jobs, newest first, filtered by state; the filter is in the URL. */

import { fill, h, keyedList, setText } from "../base/dom.js";
import { hidden, jobs, workers } from "../news/farm.js";
import { emptyState, noWorkerNotice } from "../shell/hints.js";
import { here, linkTo, setParams, setTitle } from "../shell/router.js";
import { Disposer } from "../base/store.js";
import { jobRow } from "./job-row.js";

/** @typedef {import("../base/types.js").Job} Job */

/** @type {[string, string, (job: Job) => boolean][]} */
const FILTERS = [
  ["all", "All", () => true],
  ["active", "Active", ({ state }) => ["queued", "running", "paused"].includes(state)],
  ["finished", "Finished", ({ state }) => state === "finished"],
  ["stopped", "Cancelled and failed", ({ state }) => ["cancelled", "failed"].includes(state)],
];

/** @returns {{element: HTMLElement, dispose: () => void}} */
export function jobsView() {
  setTitle("Jobs");
  const life = new Disposer();
  let filter = here().params.get("show") ?? "all";
  const notice = h("div", { class: "notice-slot" });
  const list = h("ul", { class: "rows" });
  const empty = h("div", null);
  const show = keyedList(
    list,
    (job) => job.id,
    (job) => jobRow(job, life),
  );

  const tabs = FILTERS.map(([key, label]) => {
    const tally = h("span", { class: "number" });
    const button = h("button", { type: "button", onclick: () => choose(key) }, label, " ", tally);
    return { key, button, tally };
  });

  /** @param {string} key */
  const choose = (key) => {
    filter = key;
    setParams({ show: key === "all" ? null : key });
    refresh();
  };

  const refresh = () => {
    if (!jobs.value) return;
    const seen = jobs.value.filter((job) => !hidden.value.has(job.id));
    for (const { key, button, tally } of tabs) {
      const matches = FILTERS.find(([name]) => name === key)?.[2] ?? (() => true);
      button.setAttribute("aria-pressed", String(key === filter));
      setText(tally, seen.filter(matches).length);
    }
    const chosen = seen.filter(FILTERS.find(([name]) => name === filter)?.[2] ?? (() => true));
    show(chosen);
    list.hidden = chosen.length === 0;
    if (chosen.length) fill(empty);
    else if (seen.length) fill(empty, emptyState("image", "No job is in this state"));
    else
      fill(
        empty,
        emptyState(
          "image",
          "No pictures yet",
          h(
            "p",
            null,
            "Open a scene, press Render, and its picture appears here. ",
            h("a", { href: linkTo() }, "To the scenes"),
          ),
        ),
      );
  };
  life.add(jobs.subscribe(refresh));
  life.add(hidden.subscribe(refresh));
  life.add(workers.subscribe((all) => fill(notice, all?.length === 0 && noWorkerNotice())));

  const element = h(
    "div",
    { class: "page" },
    h("h1", { class: "page-title" }, "Jobs"),
    h(
      "div",
      { class: "tabs", role: "group", "aria-label": "Show" },
      tabs.map(({ button }) => button),
    ),
    notice,
    list,
    empty,
  );
  return { element, dispose: () => life.dispose() };
}
