/** Jobs that a view in the hand makes: they are left out of lists while they run. */

/** @typedef {import("../base/types.js").Job} Job */

export const PREVIEW_NAME = "View preview";

/** @param {Job} job */
export const isPassing = ({ name, state }) => name === PREVIEW_NAME && (state === "queued" || state === "running");
