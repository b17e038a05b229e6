/** All settings of a picture with their ranges, names and descriptions, from GET /api/info. */

import { Store } from "../base/store.js";
import { count } from "../base/format.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Setting} Setting */
/** @typedef {import("../base/types.js").SettingsTable} SettingsTable */

/** Null until loaded, which happens before scenes and jobs are loaded. */
export const table = new Store(/** @type {SettingsTable | null} */ (null));

/**
 * Translates the settings' texts to the language of the page.
 *
 * @param {SettingsTable} english
 * @returns {SettingsTable}
 */
export function inWords({ defaults, settings, view, work, shot, channels, version, views }) {
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
  return { defaults, settings: said(settings), view: said(view), work: said(work), shot: said(shot), channels: planes, version, views };
}

/** @returns {SettingsTable} */
export function known() {
  if (!table.value) throw new Error("The farm has not told its settings yet.");
  return table.value;
}

/**
 * @param {Exclude<keyof SettingsTable, "channels" | "version" | "views" | "defaults">} part
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
 * Formats a value for display.
 *
 * @param {Setting} setting
 * @param {any} value
 * @returns {string}
 */
export function valueText(setting, value) {
  if (value == null) return setting.off?.label ?? "";
  if (setting.choices) return setting.choices.find(({ name }) => name === value)?.label ?? value;
  if (setting.off && value === setting.off.value) return setting.off.label;
  if (setting.type === "names") return value.split(",").join(", ");
  if (Array.isArray(value)) return value.map(short).join(", ");
  return setting.unit === "fraction" ? `${short(value * 100)} %` : String(short(value));
}

/**
 * Formats a value as part of a picture's description.
 *
 * @param {Setting} setting
 * @param {any} value
 */
export const phraseOf = (setting, value) =>
  setting.name === "spp" && value != null ? tn(value, "{n} sample", "{n} samples") : setting.phrase.replace("{}", valueText(setting, value));

/**
 * Describes a job's goal briefly. With a target noise or time, samples are only a limit.
 *
 * @param {{spp: number | null, noise?: number | null, seconds?: number | null}} job
 */
export function endOf({ spp, noise = null, seconds = null }) {
  const name = noise !== null ? "noise" : seconds !== null ? "seconds" : "spp";
  const value = noise ?? seconds ?? spp;
  return value === null ? "" : phraseOf(settingOf("work", name), value);
}

/** States of jobs that may have ended before their goal. */
const STOPPED = ["cancelled", "failed", "paused"];

/** Returns the samples per pixel that a job's picture has, in whole samples. @param {import("../base/types.js").Job} job */
const samplesOf = ({ samples, width, height, shot }) => Math.floor(samples / Math.max((width ?? 1) * (height ?? 1) * (shot?.count ?? 1), 1));

/**
 * Describes the quality of a job's picture: its goal, or its number of samples if it was stopped earlier.
 *
 * @param {import("../base/types.js").Job} job
 */
export function reached(job) {
  return STOPPED.includes(job.state) ? phraseOf(settingOf("work", "spp"), samplesOf(job)) : endOf(job);
}

/**
 * Describes what a job's picture shows now: as `reached`, but of an unfinished job what it has so far, and its goal.
 *
 * @param {import("../base/types.js").Job} job
 */
export function shownQuality(job) {
  if (job.state === "finished" || STOPPED.includes(job.state)) return reached(job);
  if (job.spp !== null && job.noise == null && job.seconds == null) return t("{n} of {all} samples", { n: count(samplesOf(job)), all: count(job.spp) });
  const now = phraseOf(settingOf("work", "spp"), samplesOf(job));
  const goal = endOf(job);
  return goal ? t("{quality} until {goal}", { quality: now, goal }) : now;
}

/** Four digits suffice to tell pictures apart; whole numbers are shown in full. @param {number} value */
const short = (value) => (Number.isInteger(value) ? value : Number(value.toPrecision(4)));
