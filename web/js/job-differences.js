/** In what two jobs differ: for the table beside their comparison, and for what each side is called. */

import { DENOISED, channelOf } from "./channels.js";
import { known, phraseOf, settingOf } from "./settings-table.js";

/** @typedef {import("./types.js").Job} Job */
/** @typedef {import("./types.js").Setting} Setting */

/** At most this many differences name a side; the table has all of them. */
const NAMED_BY = 2;

/** Basic settings tell most, those of the lab more than what stays as it is. */
const TELLING = ["basic", "lab", "advanced"];

/**
 * What is compared, the most telling first.
 *
 * @returns {{label: string, read: (job: Job) => string}[]}
 */
function rows() {
  const { settings, view } = known();
  /** @param {Setting} setting @param {(job: Job) => Record<string, any> | undefined} part */
  const row = (setting, part) => ({
    label: setting.label,
    read: (/** @type {Job} */ job) => {
      const values = part(job);
      return values && setting.name in values ? phraseOf(setting, values[setting.name]) : "";
    },
  });
  const spp = settingOf("work", "spp");
  const noise = settingOf("work", "noise");
  const ofJob = settings.filter(({ name }) => name !== "width" && name !== "height");
  const byTelling = TELLING.flatMap((group) => ofJob.filter((setting) => setting.group === group));
  return [
    { label: "Scene", read: ({ name }) => name },
    ...byTelling.map((setting) => row(setting, (job) => job.settings ?? undefined)),
    { label: spp.label, read: (job) => (job.noise == null ? job.spp && phraseOf(spp, job.spp) : phraseOf(noise, job.noise)) || "" },
    ...view.map((setting) => row(setting, (job) => job.settings?.view)),
    { label: "Size", read: ({ width, height }) => `${width}×${height}` },
  ];
}

/**
 * @param {Job} a
 * @param {Job} b
 * @returns {{label: string, a: string, b: string}[]}
 */
export function differences(a, b) {
  return rows()
    .map(({ label, read }) => ({ label, a: read(a) || "–", b: read(b) || "–" }))
    .filter((row) => row.a !== row.b);
}

/**
 * What the two sides are called: by what tells them apart.
 *
 * @param {{job: Job, channel: string}} left
 * @param {{job: Job, channel: string}} right
 * @returns {[string, string]}
 */
export function sideNames(left, right) {
  const telling = differences(left.job, right.job).slice(0, NAMED_BY);
  const isDenoised = [left.channel, right.channel].includes(DENOISED);
  const name = (/** @type {"a" | "b"} */ key, /** @type {{job: Job, channel: string}} */ { channel }) => {
    const parts = telling.map((row) => row[key]);
    if (left.channel !== right.channel || parts.length === 0)
      parts.push(isDenoised && channel === "" ? "Raw" : channelOf(channel).label);
    return parts.join(", ");
  };
  return [name("a", left), name("b", right)];
}
