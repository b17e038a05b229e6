/** Available environments: presets and uploaded images. */

import { inProject } from "../base/project.js";
import { getEnvironments, removeEnvironment } from "./api.js";
import { Listing } from "./listing.js";
import { sendFiles } from "./upload.js";

/** @typedef {import("../base/types.js").Environment} Environment */

/** @type {Listing<Environment>} */
export const environments = new Listing(getEnvironments);

/** Reloads the list. */
export async function loadEnvironments() {
  await environments.load();
}

/**
 * @param {File} file
 * @param {{progress: (sent: number, total: number) => void, signal: AbortSignal}} options
 * @returns {Promise<Environment>}
 */
export async function addEnvironment(file, options) {
  const added = /** @type {Environment} */ (await sendFiles(inProject("api/environments"), "file", [{ file, path: file.name }], options));
  await loadEnvironments();
  return added;
}

/** @param {string} id */
export async function dropEnvironment(id) {
  await removeEnvironment(id);
  await loadEnvironments();
}
