/** Fair shares of users, and of projects with their own terms. */

import { call, getPage } from "./api.js";

/**
 * @typedef {object} Share
 * @property {string} share everybody, user:NAME or project:NAME
 * @property {number} weight
 * @property {number | null} max_slots null: no limit
 * @property {number} slots that work on its jobs now
 * @property {number} jobs that are not over
 */

/** @param {number} offset @returns {Promise<import("./api.js").Page<Share>>} by name */
export const getShares = (offset) => getPage("/shares", offset);

/** @param {string} share @param {{weight: number, max_slots: number | null}} terms @returns {Promise<Share>} */
export const setShare = (share, terms) => call("PUT", `/shares/${encodeURIComponent(share)}`, { json: terms });

/** Resets a share to the default; a project loses its own share. @param {string} share @returns {Promise<Share>} */
export const resetShare = (share) => call("DELETE", `/shares/${encodeURIComponent(share)}`);
