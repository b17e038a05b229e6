/** Orders descriptions of a job, which arrive by two connections: events of the farm, and the job's own socket. */

/** @typedef {import("../base/types.js").Job} Job */

/** Larger differences are a clock of the service that was set back, not an older description. */
const CLOCK_SET_BACK_S = 60;

/**
 * Whether a description of a job is older than the known one.
 *
 * @param {Pick<Job, "as_of">} job
 * @param {Pick<Job, "as_of"> | undefined} known
 */
export function isOlder(job, known) {
  const behind = (known?.as_of ?? 0) - (job.as_of ?? 0);
  return behind > 0 && behind < CLOCK_SET_BACK_S;
}
