/** Requests for the takes of a scene: saved cameras with the settings of its live view. */

import { call, getAll } from "./api.js";

/** @typedef {import("../base/types.js").Take} Take */

/** @param {string} scene @returns {Promise<Take[]>} oldest first */
export const getTakes = (scene) => getAll(`/scenes/${scene}/takes`);

/**
 * @param {string} scene
 * @param {{name: string, author?: string, request: Record<string, any>, exposure: number, tonemap: string, picture?: string}} take
 *   author: on a farm without logins; picture: base64
 * @returns {Promise<Take>}
 */
export const addTake = (scene, take) => call("POST", `/scenes/${scene}/takes`, { json: take });

/** @param {string} scene @param {string} id @param {string} name @returns {Promise<Take>} */
export const renameTake = (scene, id, name) => call("PATCH", `/scenes/${scene}/takes/${id}`, { json: { name } });

/** @param {string} scene @param {string} id @returns {Promise<void>} */
export const deleteTake = (scene, id) => call("DELETE", `/scenes/${scene}/takes/${id}`, { keepalive: true });
