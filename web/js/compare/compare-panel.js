/** What is about the wipe of a comparison: the choice of each side, how far it is, and in what the two differ. */

import { CHANNELS, DENOISED_CHANNEL } from "../film/channels.js";
import { h, keyedList, setText } from "../base/dom.js";
import { jobs } from "../news/farm.js";
import { endOf, settingOf, valueText } from "../news/settings-table.js";
import { progressBar, stateChip } from "../shell/state-chip.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../views/compare.js").Comparison} Comparison */

/**
 * What one side shows: a job, and a channel of it.
 *
 * @param {"A" | "B"} letter
 * @param {import("../base/store.js").Store<Comparison>} state
 * @param {"a" | "b"} job
 * @param {"left" | "right"} channel
 * @param {import("../base/store.js").Disposer} life
 */
export function sideChoice(letter, state, job, channel, life) {
  const pictures = h("select", {
    "aria-label": t("Picture {letter}", { letter }),
    onchange: () => state.update((now) => ({ ...now, [job]: pictures.value })),
  });
  const showPicture = keyedList(pictures, ({ id }) => id, pictureOption);
  const channels = h(
    "select",
    {
      "aria-label": t("Channel of {letter}", { letter }),
      onchange: () => state.update((now) => ({ ...now, [channel]: channels.value })),
    },
    [...CHANNELS.slice(0, 1), DENOISED_CHANNEL, ...CHANNELS.slice(1)].map(({ name, label }) =>
      h("option", { value: name }, label),
    ),
  );
  const show = () => {
    const now = state.value;
    showPicture((jobs.value ?? []).filter(({ width, samples, id }) => (width && samples > 0) || id === now[job]));
    pictures.value = now[job];
    channels.value = now[channel];
  };
  life.add(state.subscribe(show));
  life.add(jobs.subscribe(show));
  return h(
    "div",
    { class: "side-choice" },
    h("span", { class: "letter", "aria-hidden": "true" }, letter),
    pictures,
    channels,
  );
}

/** @returns {import("../base/dom.js").Row<Job>} */
function pictureOption(/** @type {Job} */ { id }) {
  const element = h("option", { value: id });
  return {
    element,
    update(job) {
      const { name, settings, width, height } = job;
      const integrator = settings && valueText(settingOf("settings", "integrator"), settings.integrator);
      const facts = [name, integrator, endOf(job), `${width}×${height}`];
      setText(element, facts.filter(Boolean).join(" · "));
    },
  };
}

/** @param {string} letter @param {Job} job */
export function progressOf(letter, job) {
  const chip = stateChip(job.state);
  const bar = progressBar(t("Progress of {letter}", { letter }));
  return {
    element: h(
      "div",
      { class: "stack tight" },
      h("div", { class: "row" }, h("strong", null, letter), chip.element),
      bar.element,
    ),
    /** @param {Job} next */
    update(next) {
      chip.update(next.state);
      bar.update(next.progress, next.state);
    },
  };
}

/** @param {{label: string, a: string, b: string}[]} rows */
export function differenceTable(rows) {
  const head = ["", "A", "B"].map((text) => (text ? h("th", { scope: "col" }, text) : h("td")));
  return h(
    "table",
    null,
    h("thead", null, h("tr", null, head)),
    h(
      "tbody",
      null,
      rows.map(({ label, a, b }) =>
        h("tr", null, h("th", { scope: "row" }, label), h("td", null, a), h("td", null, b)),
      ),
    ),
  );
}
