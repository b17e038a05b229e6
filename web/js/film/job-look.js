/** How a job's picture is shown by default: the exposure and tone curve that its request states, and its small copies. */

import { firstFrame } from "../base/shot-words.js";
import { imageUrl, thumbnailFormat } from "../news/api.js";
import { isCurve } from "./curves.js";
import { DEFAULT_CURVE } from "./tonemap.js";

/** @typedef {Pick<import("../base/types.js").Job, "exposure" | "tonemap">} Shown */

/** @param {Shown | null | undefined} job @returns {{exposure: number, curve: string}} the default curve in place of one that the farm no longer has */
export const jobLook = (job) => ({ exposure: job?.exposure ?? 0, curve: job?.tonemap && isCurve(job.tonemap) ? job.tonemap : DEFAULT_CURVE });

/** @param {Shown | null | undefined} job @returns {{exposure?: number, tonemap?: string}} parameters of a picture that shows it so; none for the defaults */
export function lookOfJob(job) {
  const { exposure, curve } = jobLook(job);
  return { ...(exposure !== 0 && { exposure }), ...(curve !== DEFAULT_CURVE && { tonemap: curve }) };
}

/** Least width, in pixels, of the pictures of cards and rows; larger on screens with several device pixels per CSS pixel. */
export const CARD_WIDTH = devicePixelRatio > 1 ? 640 : 480;

/** Returns the URL of a job's picture on a card or in a row. @param {import("../base/types.js").Job} job */
export const cardPicture = (job) => imageUrl({ job: job.id, frame: firstFrame(job) }, thumbnailFormat(job), { width: CARD_WIDTH, visible: "true", ...lookOfJob(job), v: job.samples });

/** Returns the mean samples per pixel of a job. @param {import("../base/types.js").Job} job */
export const perPixel = ({ samples, shot, width, height }) => samples / Math.max((width ?? 1) * (height ?? 1) * (shot?.count ?? 1), 1);
