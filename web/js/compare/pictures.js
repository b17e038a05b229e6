/**
 * Pictures that can be compared: a job's current picture, a snapshot of a job, or an uploaded picture. In URLs the first two are
 * given by the job's id, the last by REFERENCE and its id.
 */

import { count } from "../base/format.js";
import { t, tn } from "../base/words.js";
import { imageUrl, referenceUrl, snapshotUrl } from "../news/api.js";
import { DENOISED } from "../film/channels.js";
import { LiveFilm } from "../film/live-film.js";
import { StillFilm } from "../film/still-film.js";
import { frameOf } from "../shot/compare-frames.js";
import { channelWord, differences, sideNames } from "./job-differences.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").Reference} Reference */

/**
 * @typedef {object} Picture
 * @property {string} id as the address has it
 * @property {string} name
 * @property {number} width
 * @property {number} height
 * @property {Job | null} job null: it was uploaded
 * @property {Reference | null} reference
 */

/** @typedef {LiveFilm | StillFilm} SideFilm */

const REFERENCE = "ref.";

/** @param {string} id as the address has it @returns {string | null} the uploaded picture's; null: it is a job's */
export const referenceId = (id) => (id.startsWith(REFERENCE) ? id.slice(REFERENCE.length) : null);

/** @param {Reference} reference @returns {string} as the address has it */
export const addressOf = ({ id }) => REFERENCE + id;

/** @param {Job} job of known size @returns {Picture} */
export const pictureOfJob = (job) => ({
  ...{ id: job.id, name: job.name, width: job.width ?? 1, height: job.height ?? 1 },
  ...{ job, reference: null },
});

/** @param {Reference} reference @returns {Picture} */
export const pictureOfReference = (reference) => ({
  ...{ id: addressOf(reference), name: reference.name, width: reference.width, height: reference.height },
  ...{ job: null, reference },
});

/**
 * @param {Picture} picture
 * @param {number | null} at samples a pixel; null: as it is now
 * @param {number | null} frame
 * @returns {SideFilm}
 */
export function filmOf({ job, reference, width, height }, at, frame) {
  if (reference) return new StillFilm(referenceUrl(reference.id, "film"), { width, height }, { hasSamples: false });
  if (!job) throw new Error("A side is a job's or an uploaded picture.");
  if (at !== null) return new StillFilm(snapshotUrl(job.id, at, "film"), { width, height }, { job: job.id });
  return new LiveFilm(job, frameOf(job, frame));
}

/**
 * URL of a picture as a PNG that looks as displayed.
 *
 * @param {Picture} picture
 * @param {string} channel
 * @param {number | null} at
 * @param {{exposure: number, curve: string, frame: number | null}} look
 */
export function pictureUrl({ job, reference }, channel, at, { exposure, curve, frame }) {
  const look = { exposure, tonemap: curve };
  const text = `?${new URLSearchParams({ exposure: String(exposure), tonemap: curve })}`;
  if (reference) return referenceUrl(reference.id, "image.png") + text;
  const id = job?.id ?? "";
  if (at !== null) return snapshotUrl(id, at, "image.png") + text;
  /** @type {Record<string, string | number>} */
  const query = channel === DENOISED ? { ...look, denoise: "true" } : channel ? { aov: channel } : look;
  return imageUrl({ job: id, frame: (job && frameOf(job, frame)) ?? 0 }, "png", query);
}

/** @param {number | null} at */
export const momentName = (at) => (at === null ? t("now") : tn(at, "{n} sample", "{n} samples", { n: count(at) }));

/** @typedef {{picture: Picture, channel: string, at: number | null}} Side */

/**
 * Names of the two sides, from their differences.
 *
 * @param {Side} a
 * @param {Side} b
 * @returns {[string, string]}
 */
export function namesOf(a, b) {
  /** @type {[string, string]} */
  let base = ["", ""];
  const [first, second] = [a.picture.job, b.picture.job];
  if (first && second) {
    const isMoment = first.id === second.id && a.channel === b.channel && a.at !== b.at;
    if (!isMoment) base = sideNames({ job: first, channel: a.channel }, { job: second, channel: b.channel });
  } else {
    base = [a.picture.name, b.picture.name];
  }
  const isTimed = a.at !== null || b.at !== null;
  const name = (/** @type {Side} */ side, /** @type {string} */ text) =>
    [text, isTimed && side.picture.job ? momentName(side.at) : ""].filter(Boolean).join(", ");
  return [name(a, base[0]), name(b, base[1])];
}

/**
 * Differences of two pictures for a table; for an uploaded picture, only its known properties.
 *
 * @param {Side} a
 * @param {Side} b
 * @returns {{label: string, a: string, b: string}[]}
 */
export function differencesOf(a, b) {
  const [first, second] = [a.picture.job, b.picture.job];
  const rows = first && second ? differences(first, second) : [];
  const row = (/** @type {string} */ label, /** @type {(side: Side) => string} */ tell) => ({ label, a: tell(a), b: tell(b) });
  if (!first || !second) {
    rows.push(
      row(t("Picture"), ({ picture }) => picture.name),
      row(t("Light"), ({ picture }) => lightOf(picture)),
      row(t("Size"), ({ picture: { width, height } }) => `${width}×${height}`),
    );
  }
  if (a.channel !== b.channel) rows.push(row(t("Channel"), ({ picture, channel }) => (picture.job ? channelWord(channel, [a.channel, b.channel]) : "–")));
  if (a.at !== b.at) rows.push(row(t("Moment"), (side) => (side.picture.job ? momentName(side.at) : "–")));
  return rows;
}

/** @param {Picture} picture */
function lightOf({ reference }) {
  if (!reference) return t("linear Rec.709");
  return reference.display_referred ? t("sRGB of 8 bits, made linear") : t("read as linear Rec.709");
}
