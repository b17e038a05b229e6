/** A job's history: its noise against time with a forecast, and its events. */

import { getHistory } from "../news/api.js";
import { fill, h, setText } from "../base/dom.js";
import { clock, roughly } from "../base/format.js";
import { said as inWords } from "../base/said.js";
import { withFold } from "../shell/layouts.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../news/api.js").History} History */

const RENEW_MS = 3000;
const WIDTH = 240;
const HEIGHT = 120;
/** Greatest ratio of the forecast, as drawn, to the elapsed time. */
const FORECAST = 10;
/** Longest forecast that is stated in words, in seconds: one of days rests on too little. */
const STATED_S = 86_400;
/** Relative noise of a picture that counts as clean. */
const CLEAN = 0.01;

/** @type {Record<string, (words: string) => string>} */
const WORDS = {
  begun: (kind) => t("Started with version {version}", { version: kind.split("-")[0] ?? kind }),
  taken: (job) => t("Started with the samples of job {job}", { job }),
  picture: () => t("First picture: every tile has a sample"),
  worker: (name) => t("{name} renders it", { name }),
  left: (name) => t("{name} has left", { name }),
  paused: () => t("Paused"),
  resumed: () => t("Resumed"),
  lost: (name) => (name ? t("A batch did not come back from {name}; tried again", { name }) : t("A batch did not come back; tried again")),
  late: () => t("Expected to miss its deadline"),
  "in-time": () => t("Expected to meet its deadline again"),
  healed: () => t("Its film was damaged; the missing part is rendered again"),
  distrusted: (name) => t("{name} rendered something different from other workers; its part is rendered again", { name }),
  failed: (words) => t("A batch failed, and is tried again. {words}", { words: inWords(words) }),
};

/** @param {number} noise */
const percent = (noise) => `${Number((noise * 100).toPrecision(2))} %`;

/**
 * Leaves out that a resumed job goes on with the version it was begun with.
 *
 * @param {History["events"][number]} event
 * @param {number} i
 * @param {History["events"]} all
 */
const isNews = ({ kind, words }, i, all) => kind !== "begun" || all.findIndex((other) => other.kind === kind && other.words === words) === i;

/** @param {() => Job} job @param {import("../base/store.js").Disposer} life */
export function historyPanel(job, life) {
  const said = h("p", { class: "quiet small number" });
  const chart = h("div", { class: "chart" });
  const events = h("ol", { class: "timeline number" });
  const element = withFold("history", h("details", { class: "side-section history" }, h("summary", null, h("h2", null, t("History"))), h("div", { class: "stack tight" }, said, chart, events)));
  let asking = new AbortController();
  life.add(() => asking.abort());
  let shown = "";
  const renew = async () => {
    if (!element.open) return;
    asking.abort();
    asking = new AbortController();
    try {
      const history = await getHistory(job().id, asking.signal);
      const key = JSON.stringify([history, job().state]);
      if (key !== shown) show(history);
      shown = key;
    } catch {
      // Connection lost or job deleted, as shown elsewhere.
    }
  };
  element.addEventListener("toggle", () => void renew());
  life.every(RENEW_MS, () => (job().state === "running" || !shown) && void renew());

  /** @param {History} history */
  const show = (history) => {
    const points = history.points.flatMap(({ seconds, noise }) => (noise && seconds > 0 ? [{ seconds, noise }] : []));
    const last = points.at(-1);
    // The error falls with the square root of the samples.
    const left = last ? last.seconds * ((last.noise / CLEAN) ** 2 - 1) : 0;
    const open = job().state === "running" && last && last.noise > CLEAN && left < STATED_S;
    setText(said, last ? t("Noise {noise} after {time}", { noise: percent(last.noise), time: clock(last.seconds) }) + (open ? t("; {noise} in {time}.", { noise: percent(CLEAN), time: roughly(left) }) : ".") : t("The noise is known after the first samples."));
    fill(chart, points.length > 1 && last ? plot(points, left) : null);
    const { created, finished, state } = job();
    const all = [
      { at: created, text: t("Requested") },
      ...history.events.filter(isNews).map(({ at, kind, words }) => ({ at, text: (WORDS[kind] ?? (() => kind))(words) })),
      ...(finished ? [{ at: finished, text: state === "finished" ? t("Finished") : state === "failed" ? t("Failed") : t("Cancelled") }] : []),
    ];
    fill(events, ...all.map(({ at, text }) => h("li", null, h("span", { class: "quiet" }, clock(Math.max(at - created, 0))), h("span", null, text))));
  };
  return {
    element,
    update: () => void (job().state === "running" || renew()),
  };
}

/**
 * Plots with logarithmic axes, where a converging picture is a straight line.
 *
 * @param {{seconds: number, noise: number}[]} points
 * @param {number} left seconds until it is clean; 0 or less: it is
 */
function plot(points, left) {
  const first = /** @type {{seconds: number, noise: number}} */ (points[0]);
  const last = /** @type {{seconds: number, noise: number}} */ (points.at(-1));
  const end = Math.max(Math.min(last.seconds + Math.max(left, 0), FORECAST * last.seconds), first.seconds * 2);
  const noises = points.map(({ noise }) => noise);
  const [most, least] = [Math.max(...noises), Math.min(...noises, CLEAN)];
  const x = (/** @type {number} */ s) => (Math.log(s / first.seconds) / Math.log(end / first.seconds)) * WIDTH;
  const y = (/** @type {number} */ n) => (Math.log(most / n) / Math.log(most / least || 2)) * HEIGHT;
  const line = points.map(({ seconds, noise }, i) => `${i ? "L" : "M"}${x(seconds).toFixed(1)} ${y(noise).toFixed(1)}`).join("");
  const label = t("Noise against time: {from} after {start}, {to} after {end}", { from: percent(first.noise), start: clock(first.seconds), to: percent(last.noise), end: clock(last.seconds) });
  const svg = shape("svg", { viewBox: `-2 -4 ${WIDTH + 4} ${HEIGHT + 8}`, role: "img", "aria-label": label });
  svg.append(shape("path", { d: `M0 ${y(CLEAN).toFixed(1)}H${WIDTH}`, class: "goal" }));
  const reached = last.noise * Math.sqrt(last.seconds / end); // CLEAN, unless the forecast is cut
  if (left > 0) svg.append(shape("path", { d: `M${x(last.seconds).toFixed(1)} ${y(last.noise).toFixed(1)}L${x(end).toFixed(1)} ${y(reached).toFixed(1)}`, class: "forecast" }));
  svg.append(shape("path", { d: line, class: "line" }));
  const ends = [clock(first.seconds), percent(most), clock(end)];
  return h("figure", null, h("span", { class: "quiet small" }, t("{most} to {least}, logarithmic", { most: percent(most), least: percent(least) })), svg, h("div", { class: "ticks quiet small", "aria-hidden": "true" }, h("span", null, ends[0]), h("span", null, ends[2])));
}

/** @param {string} name @param {Record<string, string>} attributes */
function shape(name, attributes) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) element.setAttribute(key, value);
  return element;
}
