/** A job's place in the queue: its dependencies, deadline, and maximum slots. */

import { change } from "./job-panel.js";
import { fill, h, setText } from "../base/dom.js";
import { roughly } from "../base/format.js";
import { icon } from "../base/icons.js";
import { saidOf } from "../base/said.js";
import { t } from "../base/words.js";
import { queueFields } from "../forms/queue-fields.js";
import { mayChange } from "../news/projects.js";
import { linkTo } from "../shell/router.js";
import { stateChip } from "../shell/state-chip.js";

/** @typedef {import("../base/types.js").Job} Job */

const OPEN = ["queued", "running", "paused"];

/** Seconds beyond which a forecast is only shown as too late. */
const FORESEEN_S = 30 * 86400;

/** @returns {{element: HTMLElement, update: (job: Job) => void}} */
export function queuePanel() {
  /** @type {Job | null} */
  let latest = null;
  /** @param {Parameters<typeof change>[1]} asked */
  const ask = (asked) => latest && void change(latest, asked, t("The job was not changed"));

  const late = h("div", { class: "notice warning", role: "status", hidden: true });
  const lateText = h("div", { class: "grow" });
  late.append(icon("clock"), lateText);
  const waitList = h("ul", { class: "waits" });
  const waits = h(
    "div",
    { class: "stack tight", hidden: true },
    h("h2", null, t("Waiting for")),
    waitList,
    h("button", { class: "button small for-submit", type: "button", onclick: () => ask({ after: [] }) }, t("Start without waiting")),
  );
  const fields = queueFields((part) => ask(part));
  const ready = h("p", { class: "quiet small number", hidden: true });
  const more = h(
    "details",
    { class: "among" },
    h("summary", null, h("h2", null, t("Queue"))),
    h("div", { class: "stack" }, fields.elements),
  );
  const element = h("section", { class: "side-section queue stack", "aria-label": t("Queue") }, late, waits, ready, more);
  let shown = "";
  return {
    element,
    update(job) {
      latest = job;
      const isOpen = OPEN.includes(job.state);
      element.hidden = !isOpen;
      if (!isOpen) return;
      late.hidden = job.late == null;
      setText(lateText, lateWords(job));
      setText(ready, readyWords(job));
      ready.hidden = !ready.textContent;
      fields.put(job);
      for (const input of fields.elements.flatMap((each) => [...each.querySelectorAll("input")])) input.disabled = !mayChange(job.project);
      const all = job.waits_for ?? [];
      waits.hidden = !all.length;
      const key = JSON.stringify(all);
      if (key === shown) return;
      shown = key;
      fill(waitList, ...all.map(waitRow));
    },
  };
}

/** @param {import("../base/types.js").Wait} wait */
function waitRow({ id, name, state }) {
  const label = name ?? t("A picture");
  return h("li", null, h("a", { href: linkTo("jobs", id), title: label }, label), state && stateChip(state).element);
}

/** @param {Job} job */
function lateWords({ deadline, expected, late }) {
  if (deadline == null || late == null) return "";
  const over = Date.now() / 1000 - deadline;
  if (over > 0) return t("Its deadline has passed: {time}.", { time: dayAndTime(deadline) });
  const by = (expected ?? 0) - deadline;
  return by > 0 && by < FORESEEN_S
    ? t("Deadline: {time}; the forecast is {late} later.", { time: dayAndTime(deadline), late: roughly(by) })
    : t("Deadline: {time}; the forecast misses it.", { time: dayAndTime(deadline) });
}

/** @param {Job} job */
function readyWords(job) {
  const { deadline, expected, late } = job;
  if (deadline == null || late != null) return "";
  return expected == null
    ? [t("Deadline: {time}.", { time: dayAndTime(deadline) }), saidOf(job, "unforeseen")].filter(Boolean).join(" ")
    : t("Deadline: {time}; the forecast is {ready}.", { time: dayAndTime(deadline), ready: dayAndTime(expected) });
}

/** @param {number} at unix seconds */
const dayAndTime = (at) => new Date(at * 1000).toLocaleString([], { weekday: "short", day: "numeric", month: "short", hour: "2-digit", minute: "2-digit" });
