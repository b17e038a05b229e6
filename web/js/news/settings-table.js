/** What a picture can be asked for: each setting with its range, its names and its words, as GET /api/info says them. */

import { Store } from "../base/store.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Setting} Setting */
/** @typedef {import("../base/types.js").SettingsTable} SettingsTable */

/** Null until the farm has told it, which it does before it tells of scenes and jobs. */
export const table = new Store(/** @type {SettingsTable | null} */ (null));

/**
 * What the farm says of its settings, in the language of the page.
 *
 * @param {SettingsTable} english
 * @returns {SettingsTable}
 */
export function inWords({ settings, view, work, shot, channels }) {
  /** @param {Setting[]} all */
  const said = (all) =>
    all.map((setting) => ({
      ...setting,
      label: t(setting.label),
      help: t(setting.help),
      section: t(setting.section),
      phrase: t(setting.phrase),
      off: setting.off && { ...setting.off, label: t(setting.off.label) },
      choices: setting.choices?.map((choice) => ({ ...choice, label: t(choice.label), help: t(choice.help) })) ?? null,
    }));
  const planes = channels.map(({ name, label, help, values }) => ({
    ...{ name, label: t(label), help: t(help) },
    values: values.map((each) => t(each)),
  }));
  return { settings: said(settings), view: said(view), work: said(work), shot: said(shot), channels: planes };
}

/** @returns {SettingsTable} */
export function known() {
  if (!table.value) throw new Error("The farm has not told its settings yet.");
  return table.value;
}

/**
 * @param {Exclude<keyof SettingsTable, "channels">} part
 * @param {string} name
 * @returns {Setting}
 */
export function settingOf(part, name) {
  const found = known()[part].find((setting) => setting.name === name);
  if (!found) throw new Error(`The farm knows no setting ${name}.`);
  return found;
}

/** @param {Setting} setting @param {string} integrator whether that looks at the setting */
export const isRead = ({ integrators }, integrator) => !integrators || integrators.includes(integrator);

/** @param {Setting} setting @param {string} projection whether that looks at the setting */
export const isSeen = ({ projections }, projection) => !projections || projections.includes(projection);

/** @param {Setting} setting */
export const labelOf = ({ label, unit }) => {
  const shown = /** @type {Record<string, string>} */ ({ "°": "°", s: "s", fraction: "%" })[unit];
  return shown ? `${label}, ${shown}` : label;
};

/**
 * A value as a person reads it.
 *
 * @param {Setting} setting
 * @param {any} value
 * @returns {string}
 */
export function valueText(setting, value) {
  if (value == null) return setting.off?.label ?? "";
  if (setting.choices) return setting.choices.find(({ name }) => name === value)?.label ?? value;
  if (setting.off && value === setting.off.value) return setting.off.label;
  if (Array.isArray(value)) return value.map(short).join(", ");
  return setting.unit === "fraction" ? `${short(value * 100)} %` : String(short(value));
}

/**
 * A value as it names a picture.
 *
 * @param {Setting} setting
 * @param {any} value
 */
export const phraseOf = (setting, value) => setting.phrase.replace("{}", valueText(setting, value));

/**
 * What a job ends at, in a few words. Beside a noise level or a time, samples are but a cap.
 *
 * @param {{spp: number | null, noise?: number | null, seconds?: number | null}} job
 */
export function endOf({ spp, noise = null, seconds = null }) {
  const name = noise !== null ? "noise" : seconds !== null ? "seconds" : "spp";
  const value = noise ?? seconds ?? spp;
  return value === null ? "" : phraseOf(settingOf("work", name), value);
}

/** Four digits tell pictures apart; whole numbers are whole. @param {number} value */
const short = (value) => (Number.isInteger(value) ? value : Number(value.toPrecision(4)));
