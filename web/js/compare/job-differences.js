/** Differences between two jobs, for the table of a comparison and the names of its sides. */

import { DENOISED, channelOf } from "../film/channels.js";
import { scenes } from "../news/farm.js";
import { isLightless, lightWords, ownLight } from "../base/light-words.js";
import { variantOf } from "../base/scene-version.js";
import { known, labelOf, phraseOf, settingOf, shownQuality, valueText } from "../news/settings-table.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").Setting} Setting */

/** Maximum number of differences in a side's name; the table has all. Two scenes have their names alone. */
const NAMED_BY = 2;

/** Settings that add planes to a film and leave its picture as it is. */
const BESIDE = ["light_groups", "light_paths", "cryptomatte", "deep"];

/** Labels of settings whose own are understood only among those of the view. @type {Record<string, string>} */
const VIEW_LABELS = { eye: t("Camera position"), target: t("Camera target"), up: t("Camera's up") };

/** Sections of settings, most significant first. */
const SECTIONS_BY_SIGNIFICANCE = ["basic", "lab", "advanced"];

/**
 * A compared property: its label, its value in the table, and its part of a side's name.
 *
 * @typedef {object} Row
 * @property {string} label
 * @property {(job: Job) => string} value
 * @property {(job: Job) => string} phrase
 * @property {boolean} [isBeside] whether it only adds planes beside the picture
 */

/** @returns {Row[]} the most telling first */
function rows() {
  const { settings, view } = known();
  /** @param {Setting} setting @param {(job: Job) => Record<string, any> | undefined} part @returns {Row} */
  const row = (setting, part) => {
    const told = (/** @type {Job} */ job, /** @type {typeof valueText} */ tell) => {
      const values = part(job);
      return values ? tell(setting, setting.name in values ? values[setting.name] : setting.default) : "";
    };
    return { label: VIEW_LABELS[setting.name] ?? labelOf(setting), isBeside: BESIDE.includes(setting.name), value: (job) => told(job, coordinates), phrase: (job) => told(job, phraseOf) };
  };
  /** @param {string} label @param {(job: Job) => string} value @returns {Row} */
  const plain = (label, value) => ({ label, value, phrase: value });
  const ofJob = settings.filter(({ name, of }) => name !== "width" && name !== "height" && of !== "environment");
  const byTelling = SECTIONS_BY_SIGNIFICANCE.flatMap((group) => ofJob.filter((setting) => setting.group === group));
  return [
    plain(t("Scene"), nameOfScene),
    plain(t("Materials"), (job) => materialsOf(job) || t("as saved")),
    {
      label: t("Environment light"),
      value: (job) => lightOf(job) || ownLight(sceneOf(job)),
      phrase: (job) => lightOf(job) || (isLightless(sceneOf(job) ?? {}) ? ownLight(sceneOf(job)) : t("light of the file")),
    },
    ...byTelling.map((setting) => row(setting, (job) => job.settings ?? undefined)),
    plain(settingOf("work", "spp").label, shownQuality),
    ...view.map((setting) => row(setting, (job) => job.settings?.view)),
    plain(t("Size"), ({ width, height }) => `${width}×${height}`),
  ];
}

/** Formats a value as `valueText` does, and a vector with the names of its axes. @type {typeof valueText} */
const coordinates = (setting, value) => {
  const text = valueText(setting, value);
  return Array.isArray(value) && value.length === 3 ? text.split(", ").map((number, i) => `${"xyz"[i]}\u00a0${number}`).join(", ") : text;
};

/** @param {Job} job */
const sceneOf = (job) => scenes.value?.find(({ id }) => id === job.scene);

/** @param {Job} job */
const nameOfScene = (job) => sceneOf(job)?.name ?? job.name;

/** @param {Job} job @returns {string} empty: the scene's own, or what stands in for it */
const lightOf = (job) => lightWords(job.environment, sceneOf(job));

/** @param {Job} job @returns {string} empty: the file's own */
function materialsOf(job) {
  const scene = sceneOf(job);
  return variantOf(job.variant == null ? scene : { variants: scene?.variants ?? [], variant: job.variant });
}

/** @param {Job} a @param {Job} b */
const differing = (a, b) => rows().filter(({ value }) => value(a) !== value(b));

/**
 * @param {Job} a
 * @param {Job} b
 * @returns {{label: string, a: string, b: string}[]}
 */
export const differences = (a, b) =>
  differing(a, b).map(({ label, value }) => ({ label, a: value(a) || "–", b: value(b) || "–" }));

/** Whether two jobs differ in anything that their pictures show. @param {Job} a @param {Job} b */
export const isOtherPicture = (a, b) => differing(a, b).some(({ isBeside }) => !isBeside);

/**
 * Names of the two sides, from their differences.
 *
 * @param {{job: Job, channel: string}} left
 * @param {{job: Job, channel: string}} right
 * @returns {[string, string]}
 */
export function sideNames(left, right) {
  const all = differing(left.job, right.job);
  const isOfTwoScenes = left.job.scene !== right.job.scene && nameOfScene(left.job) !== nameOfScene(right.job);
  const telling = all.filter(({ isBeside }) => !isBeside).slice(0, isOfTwoScenes ? 1 : NAMED_BY);
  const name = (/** @type {{job: Job, channel: string}} */ { job, channel }) => {
    const parts = telling.map(({ phrase }) => phrase(job) || "–");
    if (left.channel !== right.channel || parts.length === 0)
      parts.push(channelWord(channel, [left.channel, right.channel]));
    return parts.join(", ");
  };
  return [name(left), name(right)];
}

/**
 * The name of a side's channel; the colour is "raw" where the other side is denoised.
 *
 * @param {string} channel
 * @param {string[]} both
 */
export const channelWord = (channel, both) => (channel === "" && both.includes(DENOISED) ? t("Raw") : channelOf(channel).label);
