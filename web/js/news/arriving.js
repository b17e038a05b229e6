/** Uploads of this page that are in progress, for the front page's cards. */

import { Store } from "../base/store.js";

/**
 * @typedef {object} Arriving an upload in progress
 * @property {string} id
 * @property {string} name
 * @property {Store<number>} fraction that has been sent, 0 to 1
 */

/** begin: lists the upload again after an interruption. @typedef {Arriving & {begin: () => void, end: () => void}} Arrival */

/** Latest first. @type {Store<readonly Arriving[]>} */
export const arriving = new Store(/** @type {readonly Arriving[]} */ ([]));

let count = 0;

/**
 * Adds an upload, from its drop until the scene's page opens.
 *
 * @param {string} name
 * @returns {Arrival}
 */
export function arrive(name) {
  const upload = { id: `arriving-${(count += 1)}`, name, fraction: new Store(0) };
  const end = () => arriving.update((all) => all.filter(({ id }) => id !== upload.id));
  const begin = () => arriving.update((all) => (all.includes(upload) ? all : [upload, ...all]));
  begin();
  return { ...upload, begin, end };
}
