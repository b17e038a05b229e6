/** The quality of a picture: samples per pixel, by presets or any number. */

import { setText } from "../base/dom.js";
import { field, numberOf, segments } from "./fields.js";
import { plural } from "../base/format.js";
import { CUSTOM, QUALITIES } from "./render-presets.js";
import { numberFor } from "./setting-field.js";
import { settingOf } from "../news/settings-table.js";

const START_SPP = 128;

/**
 * @param {Record<string, any>} defaults what the scene file asks for
 * @param {() => void} changed
 * @returns {{elements: HTMLElement[], get: () => number}}
 */
export function qualityFields(defaults, changed) {
  const setting = settingOf("work", "spp");
  const spp = numberFor(setting, defaults.spp ?? START_SPP);
  spp.required = true; // the form has a number of its own where the scene has none
  const custom = field(setting.label, spp);
  const get = () => numberOf(spp, 0);
  const tell = () => {
    setText(quality.aside, `${plural(get(), "sample")} per pixel`);
    changed();
  };
  /** @param {string} name */
  const choose = (name) => {
    const preset = QUALITIES.find((candidate) => candidate.name === name);
    custom.hidden = preset !== undefined;
    if (preset) spp.value = String(preset.spp);
    else spp.focus();
    tell();
  };
  const choices = [...QUALITIES.map(({ name, label }) => ({ value: name, label })), { value: CUSTOM, label: "Custom" }];
  const quality = segments("Quality", choices, choose);
  spp.addEventListener("input", tell);

  const preset = QUALITIES.find((candidate) => candidate.spp === get());
  quality.select(preset?.name ?? CUSTOM);
  custom.hidden = preset !== undefined;
  setText(quality.aside, `${plural(get(), "sample")} per pixel`);
  return { elements: [quality.element, custom], get };
}
