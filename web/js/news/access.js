/** Requests for users, tokens, projects, quotas and the audit log. */

import { call, getPage } from "./api.js";

/** @typedef {"view" | "submit" | "admin"} Role */
/** @typedef {{name: string, role: Role, has_password: boolean, created: number, sessions: number}} User */
/** @typedef {{id: string, name: string, role: Role | "worker", user: string, created: number, expires: number | null, seen: number | null}} Token */
/** @typedef {{at: number, who: string, what: string, from?: string, about?: string, status?: number | null}} Deed */

/** Maximum number of items in a selection list. */
const CHOICE = "limit=1000";

/** @param {number} offset @returns {Promise<import("./api.js").Page<User>>} by name */
export const getUsers = (offset) => getPage("/users", offset);

/** @returns {Promise<User[]>} to choose from, by name */
export const chooseUsers = () => call("GET", `/users?${CHOICE}`);

/** @param {string} name @param {Role} role @returns {Promise<User>} */
export const addUser = (name, role) => call("POST", "/users", { json: { name, role } });

/** @param {string} name @param {Role} role @returns {Promise<User>} */
export const setRole = (name, role) => call("PATCH", `/users/${encodeURIComponent(name)}`, { json: { role } });

/** @param {string} name @returns {Promise<void>} */
export const removeUser = (name) => call("DELETE", `/users/${encodeURIComponent(name)}`);

/** @param {string} user @returns {Promise<string>} an address that lets them in, once */
export async function makeLink(user) {
  const { code } = await call("POST", "/links", { json: { user } });
  return `${location.origin}${location.pathname}#/login?code=${code}`;
}

/** What a link allows: the picture alone, or also notes on it and a verdict. @typedef {"view" | "comment"} Permission */
/** A link that shows one job without an account. @typedef {{id: string, user: string, permission: Permission, created: number, expires: number | null}} Share */

/** @param {string} job @returns {Promise<Share[]>} newest first */
export const getShares = (job) => call("GET", `/jobs/${job}/links`);

/** @param {string} job @param {number} days @param {Permission} permission @returns {Promise<string>} the link's address, which nothing else tells */
export async function makeShare(job, days, permission) {
  const { path } = await call("POST", `/jobs/${job}/links`, { json: { days, permission } });
  return new URL(path, location.origin + location.pathname).href;
}

/** @param {string} job @param {string} id @returns {Promise<void>} */
export const withdrawShare = (job, id) => call("DELETE", `/jobs/${job}/links/${id}`);

/** @param {boolean} all everybody's: for administrators @param {number} offset @returns {Promise<import("./api.js").Page<Token>>} newest first */
export const getTokens = (all, offset) => getPage(`/tokens${all ? "?all=true" : ""}`, offset);

/** @returns {Promise<Token[]>} everybody's, to choose from, newest first */
export const chooseTokens = () => call("GET", `/tokens?all=true&${CHOICE}`);

/** @param {string} name @param {Role | "worker"} role @param {number | null} days @returns {Promise<Token & {secret: string}>} */
export const makeToken = (name, role, days) => call("POST", "/tokens", { json: { name, role, days } });

/** @param {string} id @returns {Promise<void>} */
export const withdrawToken = (id) => call("DELETE", `/tokens/${id}`);

/**
 * Limits or their use: uploads and films in bytes, unfinished jobs, samples within 24 hours.
 * @typedef {{bytes: number | null, jobs: number | null, samples_day: number | null}} Amounts
 */

/** @returns {Promise<{whose: string, limits: Amounts, used: Amounts}[]>} the user's limits; empty: no limits */
export const getQuota = () => call("GET", "/quota");

/**
 * is_own: set by an administrator; otherwise the default of all users.
 * @typedef {{whose: string, limits: Amounts, used: Amounts, is_own: boolean}} Allowance
 */

/** @param {number} offset @returns {Promise<import("./api.js").Page<Allowance>>} of all users, and of tokens that have limits of their own */
export const getQuotas = (offset) => getPage("/quotas", offset);

/** @param {string} whose user:NAME or token:ID */
const quotaOf = (whose) => whose.replace(/^(user|token):(.*)/, (_, kind, name) => `/quotas/${kind}s/${encodeURIComponent(name)}`);

/** @param {string} whose @param {Amounts} limits @returns {Promise<void>} */
export const setQuota = (whose, limits) => call("PUT", quotaOf(whose), { json: limits });

/** Resets limits to the default of all users. @param {string} whose @returns {Promise<void>} */
export const forgetQuota = (whose) => call("DELETE", quotaOf(whose));

/**
 * @typedef {object} Project
 * @property {string} name
 * @property {string[]} members
 * @property {Record<string, "view" | "submit">} roles of the members, in it
 * @property {Partial<Record<"scene" | "job" | "environment" | "reference", number>>} counts
 */

/** @returns {Promise<Project[]>} by name */
export const getProjects = () => call("GET", `/projects?${CHOICE}`);

/** @param {string} name @returns {Promise<Project>} */
export const addProject = (name) => call("POST", "/projects", { json: { name } });

/** Deletes an empty project. @param {string} name @returns {Promise<void>} */
export const removeProject = (name) => call("DELETE", `/projects/${encodeURIComponent(name)}`);

/** @param {string} project @param {string} user */
const memberOf = (project, user) => `/projects/${encodeURIComponent(project)}/members/${encodeURIComponent(user)}`;

/**
 * Adds a member to a project, or changes the member's role.
 * @param {string} project
 * @param {string} user
 * @param {"view" | "submit"} role
 * @returns {Promise<Project>}
 */
export const addMember = (project, user, role) => call("PUT", memberOf(project, user), { json: { role } });

/** @param {string} project @param {string} user @returns {Promise<Project>} */
export const removeMember = (project, user) => call("DELETE", memberOf(project, user));

/** @param {number} limit @returns {Promise<Deed[]>} newest first */
export const getAudit = (limit) => call("GET", `/audit?limit=${limit}`);
