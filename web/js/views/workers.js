/** The page of machines: their state, the current work of their slots, and how to add one. */

import { getJobsOf, getJoining } from "../news/api.js";
import { fill, h, keyedList, setText } from "../base/dom.js";
import { adoptJob, jobs, workers } from "../news/farm.js";
import { compact } from "../base/format.js";
import { command, emptyState } from "../shell/hints.js";
import { setTitle } from "../shell/router.js";
import { Disposer } from "../base/store.js";
import { addMachine } from "./add-machine.js";
import { machineCard, speedOf } from "./machine.js";
import { may } from "../news/session.js";
import { sharesSection } from "./shares-section.js";
import { sitesLines } from "./sites-lines.js";
import { t, tn } from "../base/words.js";

/** @type {Set<string>} */
const asked = new Set();

/** @param {import("../base/types.js").Worker[]} all */
function fetchUnknown(all) {
  const known = new Set(jobs.value?.map(({ id }) => id));
  const unknown = new Set(all.flatMap(({ current }) => current.map(({ job }) => job)).filter((id) => id && !known.has(id) && !asked.has(id)));
  if (!jobs.value || unknown.size === 0) return;
  for (const id of unknown) asked.add(id);
  getJobsOf([...unknown].slice(0, 60)).then(
    (found) => found.forEach(adoptJob),
    () => unknown.forEach((id) => asked.delete(id)),
  );
}

/** @returns {{element: HTMLElement, dispose: () => void}} */
export function workersView() {
  setTitle(t("Workers"));
  const life = new Disposer();
  const summary = h("p", { class: "quiet number summary" });
  const terms = h("p", { class: "quiet small summary-terms" }, t("A worker is a machine, or the graphics cards of one. Its slots work side by side, each on a piece of a picture, a live view or a scene; by default it has one per processor core, or per card."));
  const list = h("ul", { class: "machines" });
  const empty = h("div", null);
  const hereCommand = h("div", null);
  const adding = h("div", null);
  if (may("admin"))
    getJoining().then(
      (joining) => {
        fill(hereCommand, command(joining.here));
        fill(adding, addMachine(joining));
      },
      (error) => fill(adding, h("p", { class: "quiet" }, error.message)),
    );
  const show = keyedList(list, (/** @type {import("../base/types.js").Worker} */ worker) => worker.name, machineCard);
  // Slots show pictures of jobs, which may be older than those loaded.
  life.add(workers.subscribe((all) => all && fetchUnknown(all)));
  life.add(jobs.subscribe(() => workers.value && show(workers.value)));
  life.add(
    workers.subscribe((all) => {
      if (!all) return;
      show(all);
      list.hidden = terms.hidden = all.length === 0;
      const slots = all.reduce((sum, w) => sum + w.slots, 0);
      const speed = all.reduce((sum, w) => sum + speedOf(w), 0);
      setText(
        summary,
        all.length
          ? t("{slots} on {workers}", {
              slots: tn(slots, "{n} slot", "{n} slots"),
              workers: tn(all.length, "{n} worker", "{n} workers"),
            }) + (speed ? t(", {speed} samples/s together", { speed: compact(speed) }) : "")
          : "",
      );
      if (all.length) fill(empty);
      else
        fill(
          empty,
          emptyState(
            "worker",
            t("No worker is connected"),
            h("p", null, may("admin") ? t("Workers do the rendering. Start one on the farm's machine:") : t("Workers do the rendering. An administrator can add one.")),
            hereCommand,
          ),
        );
    }),
  );
  const element = h(
    "div",
    { class: "page" },
    h("h1", { class: "page-title" }, t("Workers")),
    summary,
    terms,
    sitesLines(life),
    list,
    empty,
    sharesSection(life),
    h("section", { class: "section for-admin" }, h("header", null, h("h2", null, t("Add a machine"))), adding),
  );
  return { element, dispose: () => life.dispose() };
}
