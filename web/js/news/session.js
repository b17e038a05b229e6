/** The session of this browser, login and logout. On loopback no login is needed. */

import { ApiError, call } from "./api.js";
import { Store } from "../base/store.js";

/**
 * @typedef {object} Session
 * @property {boolean} login whether one is needed here
 * @property {string | null} name null: not logged in
 * @property {"view" | "submit" | "admin" | null} role
 * @property {"open" | "session" | "token" | "owner" | null} kind
 * @property {string | null} [provider] what the OpenID provider is called by which one may log in
 */

/** The session of a service without logins, also used if the service does not respond. @type {Session} */
const OPEN = { login: false, name: null, role: "admin", kind: "open" };

/** @type {Store<Session>} */
export const session = new Store(OPEN);

/** Roles in ascending order; each includes the permissions of those before it. */
const ROLES = ["view", "submit", "admin"];

/** @param {"view" | "submit" | "admin"} role */
export const may = (role) => ROLES.indexOf(session.value.role ?? "") >= ROLES.indexOf(role);

/** Returns the name of the user who requested a job; "" without login, where all jobs are the owner's. @param {{user?: string | null}} job */
export const askedBy = ({ user }) => (user === "owner" && !session.value.login ? "" : (user ?? ""));

/** Loads the session. @returns {Promise<boolean>} whether a login is required */
export async function mustLogIn() {
  try {
    session.set(await call("GET", "/session"));
  } catch (error) {
    if (!(error instanceof ApiError)) throw error;
    return false; // no response, which the banner shows
  }
  return session.value.login && session.value.name === null;
}

/** @param {{name: string, password: string} | {link: string}} shown @returns {Promise<Session>} */
export const logIn = (shown) => call("POST", "/login", { json: shown });

export async function logOut() {
  const answer = /** @type {{provider: string} | null} */ (await call("POST", "/logout"));
  if (answer?.provider) location.assign(answer.provider); // the provider redirects back here
  else location.reload();
}

/** @param {string} old empty: there is none @param {string} next @returns {Promise<void>} */
export const changePassword = (old, next) => call("PUT", "/session/password", { json: { old, new: next } });
