/** The quality of a picture: samples per pixel, by presets with their expected time and noise, or as a number. */

import { h, setText } from "../base/dom.js";
import { noiseText } from "../base/format.js";
import { expectedText } from "./expected-time.js";
import { field, numberOf, segments, typeNext } from "./fields.js";
import { CUSTOM, QUALITIES } from "./render-presets.js";
import { numberFor } from "./setting-field.js";
import { addSlider } from "./slider.js";
import { known, settingOf } from "../news/settings-table.js";
import { t, tn } from "../base/words.js";

/**
 * Expected seconds on this farm and relative noise for a sample count; null if unknown.
 *
 * @typedef {(spp: number) => import("./expected-time.js").Expectation} Expect
 */

/**
 * @param {Record<string, any>} defaults what the scene file asks for
 * @param {() => void} changed
 * @param {Expect} expect
 * @returns {{elements: HTMLElement[], get: () => number, update: () => void}} update: refreshes the expected time and noise
 */
export function qualityFields(defaults, changed, expect) {
  const setting = settingOf("work", "spp");
  const spp = numberFor(setting, defaults.spp ?? known().defaults.spp);
  spp.required = true; // the form has a default if the scene has none
  const custom = field(setting.label, spp);
  addSlider(setting, spp);
  const get = () => numberOf(spp, 0);
  const choices = [...QUALITIES, { name: CUSTOM, label: t("Custom"), spp: null }].map((quality) => {
    const costs = h("span", { class: "quality-costs number" });
    return { ...quality, costs, element: h("span", { class: "quality" }, h("span", null, quality.label), costs) };
  });
  /** @param {string} name */
  const choose = (name) => {
    const preset = QUALITIES.find((quality) => quality.name === name);
    custom.hidden = preset !== undefined;
    if (preset) spp.value = String(preset.spp);
    else typeNext(spp);
    update();
    changed();
  };
  const quality = segments(
    t("Quality"),
    choices.map(({ name, element }) => ({ value: name, label: element })),
    choose,
  );
  quality.aside.title = t("Samples per pixel: more of them leave less noise, and take longer.");
  const update = () => {
    for (const { spp: preset, costs, element } of choices) {
      const samples = preset ?? get();
      const { seconds, noise } = expect(samples);
      setText(costs, seconds === null ? String(samples) : t("~{time}", { time: expectedText(seconds) }));
      element.title = [tn(samples, "{n} sample", "{n} samples", { n: samples }), noise === null ? "" : t("{noise} noise", { noise: noiseText(noise) })].filter(Boolean).join(" · ");
    }
    setText(quality.aside, tn(get(), "{n} sample", "{n} samples", { n: get() }));
  };
  spp.addEventListener("input", () => changed());

  const preset = QUALITIES.find((each) => each.spp === get());
  quality.select(preset?.name ?? CUSTOM);
  custom.hidden = preset !== undefined;
  update();
  return { elements: [quality.element, custom], get, update };
}
