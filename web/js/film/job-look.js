/** The exposure and tone curve with which a job's picture is shown by default, which its request states. */

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
