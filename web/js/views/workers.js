/** The workers: who they are, how fast they are, what each slot does at this moment, and how to add one. */

import { fill, h, keyedList, setText } from "../base/dom.js";
import { jobs, workers } from "../news/farm.js";
import { compact, plural } from "../base/format.js";
import { addMachineHint, emptyState } from "../shell/hints.js";
import { linkTo, setTitle } from "../shell/router.js";
import { stateChip } from "../shell/state-chip.js";
import { Disposer } from "../base/store.js";

/** @typedef {import("../base/types.js").Worker} Worker */

/** @returns {{element: HTMLElement, dispose: () => void}} */
export function workersView() {
  setTitle("Workers");
  const life = new Disposer();
  const summary = h("p", { class: "quiet number summary" });
  const list = h("ul", { class: "rows" });
  const empty = h("div", null);
  const show = keyedList(list, (worker) => worker.name, workerRow);
  life.add(
    workers.subscribe((all) => {
      if (!all) return;
      show(all);
      list.hidden = all.length === 0;
      const slots = all.reduce((sum, w) => sum + w.slots, 0);
      const speed = all.reduce((sum, w) => sum + w.slots * w.samples_per_s, 0);
      setText(
        summary,
        all.length
          ? `${plural(slots, "slot")} on ${plural(all.length, "worker")}${speed ? `, ${compact(speed)} samples/s together` : ""}`
          : "",
      );
      if (all.length) fill(empty);
      else
        fill(
          empty,
          emptyState(
            "worker",
            "No worker is connected",
            h(
              "p",
              null,
              "Workers do the rendering. ",
              h("code", null, "python3 farm.py up"),
              " starts some beside the service; any machine that reaches it can join.",
            ),
          ),
        );
    }),
  );
  const element = h(
    "div",
    { class: "page" },
    h("h1", { class: "page-title" }, "Workers"),
    summary,
    list,
    empty,
    h("section", { class: "section" }, h("header", null, h("h2", null, "Add a machine")), addMachineHint()),
  );
  return { element, dispose: () => life.dispose() };
}

/** @returns {import("../base/dom.js").Row<Worker>} */
function workerRow() {
  const name = h("span", { class: "name" });
  const cpu = h("div", { class: "quiet small" });
  const chip = stateChip("starting");
  const slots = h("span", { class: "small number" });
  const speed = h("span", { class: "small number" });
  const doing = h("ul", { class: "slots number" });
  return {
    element: h("li", { class: "worker-row" }, h("div", null, name, cpu), chip.element, slots, speed, doing),
    update(worker) {
      setText(name, worker.name);
      setText(cpu, worker.cpu);
      chip.update(worker.state);
      setText(slots, plural(worker.slots, "slot"));
      setText(speed, worker.samples_per_s ? `${compact(worker.samples_per_s * worker.slots)} samples/s` : "");
      fill(doing, worker.current.map(slotLine));
    },
  };
}

/** @param {Record<string, any>} slot */
function slotLine(slot) {
  if (slot.job) {
    const job = jobs.value?.find(({ id }) => id === slot.job);
    const [x, y] = slot.tile ?? [0, 0];
    return h(
      "li",
      null,
      h("a", { href: linkTo("jobs", slot.job) }, job?.name ?? slot.job),
      h("span", { class: "quiet" }, slot.compiling ? " compiles its kernel" : ` tile ${x}, ${y}`),
    );
  }
  if (slot.scene) return h("li", null, "prepares ", h("a", { href: linkTo("scenes", slot.scene) }, "a scene"));
  return h("li", { class: "quiet" }, "idle");
}
