/** The quality of a picture: samples per pixel, by presets with their expected time and noise, or as a number. */

import { h, setText } from "../base/dom.js";
import { noiseText, roughly } from "../base/format.js";
import { field, freshId, numberOf, typeNext } from "./fields.js";
import { CUSTOM, QUALITIES } from "./render-presets.js";
import { numberFor } from "./setting-field.js";
import { addSlider } from "./slider.js";
import { settingOf } from "../news/settings-table.js";
import { t } from "../base/words.js";

const START_SPP = 128;

/**
 * Expected seconds on this farm and relative noise for a sample count; null if unknown.
 *
 * @typedef {(spp: number) => {seconds: number | null, noise: number | null}} Expect
 */

/**
 * @param {Record<string, any>} defaults what the scene file asks for
 * @param {() => void} changed
 * @param {Expect} expect
 * @returns {{elements: HTMLElement[], get: () => number, update: () => void}} update: refreshes the expected time and noise
 */
export function qualityFields(defaults, changed, expect) {
  const setting = settingOf("work", "spp");
  const spp = numberFor(setting, defaults.spp ?? START_SPP);
  spp.required = true; // the form has a default if the scene has none
  const custom = field(setting.label, spp);
  addSlider(setting, spp);
  const get = () => numberOf(spp, 0);
  const name = freshId("quality");
  const choices = [...QUALITIES, { name: CUSTOM, label: t("Custom"), spp: null }].map((quality) => {
    const costs = h("span", { class: "quality-costs number" });
    const radio = h("input", {
      type: "radio",
      name,
      value: quality.name,
      onchange() {
        custom.hidden = quality.spp !== null;
        if (quality.spp !== null) spp.value = String(quality.spp);
        else typeNext(spp);
        update();
        changed();
      },
    });
    const samples = quality.spp === null ? "" : t("{n} samples", { n: quality.spp });
    const element = h(
      "label",
      { class: "quality" },
      radio,
      h("span", { class: "quality-name" }, quality.label),
      h("span", { class: "quality-samples quiet" }, samples),
      costs,
    );
    return { ...quality, radio, costs, element };
  });
  const update = () => {
    for (const { spp: samples, costs } of choices) {
      const { seconds, noise } = samples === null ? { seconds: null, noise: null } : expect(samples);
      const takes = seconds === null ? "" : roughly(seconds).replace("about", "≈");
      setText(costs, [takes, noise === null ? "" : t("{noise} noise", { noise: noiseText(noise) })].filter(Boolean).join(" · "));
    }
  };
  spp.addEventListener("input", () => changed());

  const chosen = choices.find((quality) => quality.spp === get()) ?? choices.at(-1);
  if (chosen) chosen.radio.checked = true;
  custom.hidden = chosen?.spp !== null;
  const element = h(
    "div",
    { class: "field" },
    h("span", { class: "label", "aria-hidden": "true" }, t("Quality")),
    h(
      "div",
      { class: "qualities", role: "radiogroup", "aria-label": t("Quality") },
      choices.map((choice) => choice.element),
    ),
  );
  update();
  return { elements: [element, custom], get, update };
}
