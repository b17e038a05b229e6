/** The controls of a comparison: the selection of each side, its progress, and the differences. */

import { DENOISED_CHANNEL, channels as planes } from "../film/channels.js";
import { ago } from "../base/format.js";
import { fill, h, keyedList, setText } from "../base/dom.js";
import { addressOf, momentName, referenceId } from "./pictures.js";
import { jobs } from "../news/farm.js";
import { references } from "../news/references.js";
import { reached, settingOf, valueText } from "../news/settings-table.js";
import { progressBar, stateChip } from "../shell/state-chip.js";
import { channelWord } from "./job-differences.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../views/compare.js").Comparison} Comparison */

/**
 * Selects what one side shows: a job's channel and snapshot, or an uploaded picture.
 *
 * @param {"A" | "B"} letter
 * @param {import("../base/store.js").Store<Comparison>} state
 * @param {{picture: "a" | "b", channel: "left" | "right", at: "atA" | "atB"}} names in the state
 * @param {ReturnType<typeof import("./snapshots.js").snapshotsOf>} moments
 * @param {import("../base/store.js").Disposer} life
 */
export function sideChoice(letter, state, { picture: job, channel, at }, moments, life) {
  const pictures = h("select", {
    "aria-label": t("Picture {letter}", { letter }),
    onchange: () => state.update((now) => ({ ...now, [job]: pictures.value, [at]: null })),
  });
  const rendered = h("optgroup", { label: t("Pictures") });
  const uploaded = h("optgroup", { label: t("Reference pictures") });
  // Where a closed select can be styled: the name, cut off if there is no room, and the samples. The list has all.
  const [chosenName, chosenFact] = [h("span", { class: "chosen-name" }), h("span", { class: "quiet number" })];
  pictures.append(h("button", { type: "button", class: "chosen", inert: true }, chosenName, chosenFact), rendered, uploaded);
  const showPicture = keyedList(rendered, ({ id }) => id, pictureOption);
  const showReference = keyedList(uploaded, ({ id }) => id, referenceOption);
  const steps = h("select", {
    "aria-label": t("Moment of {letter}", { letter }),
    title: t("The picture now, or at an earlier number of samples per pixel"),
    onchange: () => state.update((now) => ({ ...now, [at]: steps.value ? Number(steps.value) : null })),
  });
  let shownSteps = "";
  const channels = h(
    "select",
    {
      "aria-label": t("Channel of {letter}", { letter }),
      onchange: () => state.update((now) => ({ ...now, [channel]: channels.value })),
    },
    [...planes().slice(0, 1), DENOISED_CHANNEL, ...planes().slice(1)].map(({ name, label }) =>
      h("option", { value: name }, label),
    ),
  );
  const show = () => {
    const now = state.value;
    showPicture((jobs.value ?? []).filter(({ width, samples, id }) => (width && samples > 0) || id === now[job]));
    showReference(references.value ?? []);
    uploaded.hidden = !references.value?.length;
    pictures.value = now[job];
    const chosen = (jobs.value ?? []).find(({ id }) => id === now[job]);
    setText(chosenName, chosen?.name ?? (references.value ?? []).find((each) => addressOf(each) === now[job])?.name ?? "");
    setText(chosenFact, chosen ? reached(chosen) : "");
    const isUploaded = referenceId(now[job]) !== null;
    const known = isUploaded ? [] : (moments.of.value[now[job]] ?? []).map(({ spp }) => spp);
    const asked = now[at];
    if (!isUploaded && asked !== null && !known.includes(asked)) known.push(asked);
    if (known.join() !== shownSteps || !steps.length) {
      shownSteps = known.join();
      fill(steps, ...[null, ...known.sort((x, y) => y - x)].map((spp) => h("option", { value: spp ?? "" }, momentName(spp))));
    }
    steps.value = asked === null || isUploaded ? "" : String(asked);
    steps.hidden = steps.length < 2;
    channels.disabled = isUploaded || asked !== null;
    channels.title = channels.disabled ? t("Only colour is stored") : "";
    setText(/** @type {HTMLOptionElement} */ (channels.options[0]), channelWord("", [now.left, now.right])); // as the tags on the picture
    channels.value = channels.disabled ? "" : now[channel];
  };
  life.add(moments.of.subscribe(show));
  life.add(references.subscribe(show));
  life.add(state.subscribe(show));
  life.add(jobs.subscribe(show));
  return h(
    "div",
    { class: "side-choice" },
    h("span", { class: "letter", "aria-hidden": "true" }, letter),
    pictures,
    channels,
    steps,
  );
}

/** @returns {import("../base/dom.js").Row<Job>} */
function pictureOption(/** @type {Job} */ { id }) {
  const element = h("option", { value: id });
  return {
    element,
    update(job) {
      const { name, settings, width, height, created } = job;
      const integrator = settings && valueText(settingOf("settings", "integrator"), settings.integrator);
      const facts = [name, reached(job), `${width}×${height}`, integrator, ago(created)]; // last, since a narrow page cuts off the end
      setText(element, facts.filter(Boolean).join(" · "));
    },
  };
}

/** @returns {import("../base/dom.js").Row<import("../base/types.js").Reference>} */
function referenceOption(/** @type {import("../base/types.js").Reference} */ reference) {
  const element = h("option", { value: addressOf(reference) });
  return { element, update: ({ name, width, height }) => setText(element, `${name} · ${width}×${height}`) };
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
