/** Requests for the notes on a job's pictures and the verdict on them. */

import { call, getAll } from "./api.js";

/** @typedef {import("../base/types.js").Note} Note */
/** @typedef {import("../base/types.js").Review} Review */

/** @param {string} job @returns {Promise<Note[]>} oldest first, replies included */
export const getNotes = (job) => getAll(`/jobs/${job}/notes`);

/**
 * @param {string} job
 * @param {{text: string, author?: string, frame?: number, x?: number, y?: number, reply_to?: string}} note x, y: fractions of the
 *   picture's width and height; left out: the whole picture. author: on a farm without logins
 * @returns {Promise<Note>}
 */
export const addNote = (job, note) => call("POST", `/jobs/${job}/notes`, { json: note });

/** @param {string} job @param {string} id @param {{resolved: boolean, author?: string}} change @returns {Promise<Note>} */
export const resolveNote = (job, id, change) => call("PATCH", `/jobs/${job}/notes/${id}`, { json: change });

/** Deletes a note with its replies. @param {string} job @param {string} id @returns {Promise<void>} */
export const deleteNote = (job, id) => call("DELETE", `/jobs/${job}/notes/${id}`, { keepalive: true });

/** @param {string} job @param {{state: Review["state"], author?: string}} verdict @returns {Promise<Review>} */
export const setVerdict = (job, verdict) => call("PUT", `/jobs/${job}/review`, { json: verdict });
