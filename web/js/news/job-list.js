/** Filtered and sorted lists of jobs: the ids of all, and the jobs themselves for visible rows. */

import { changeJobs, getJobIds, getJobsOf, getTallies } from "./api.js";
import { jobNews, jobs } from "./farm.js";
import { Disposer, Store } from "../base/store.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").JobState} JobState */
/** @typedef {Partial<Record<JobState, number>>} Tallies */

/**
 * Filter and order of a list, as query of GET /api/jobs.
 * @typedef {{search?: string, state?: JobState[], scene?: string, shot?: string, sort?: string}} JobQuery
 */

/** Events come in bursts; one query covers all of them. */
const GATHER_MS = 400;
const AT_ONCE = 60;
const AGAIN_MS = 2000;

/** A list of jobs. */
export class JobList {
  /** @param {() => void} changed */
  constructor(changed) {
    this.changed = changed;
    /** In order; null until loaded. @type {string[] | null} */
    this.ids = null;
    /** Number of matching jobs by state, ignoring the filter on states. @type {Tallies} */
    this.tallies = {};
    /** Error of the latest query. @type {string | null} */
    this.error = null;
    /** @type {JobQuery} */
    this.query = {};
    /** @type {Map<string, Job>} */
    this.rows = new Map();
    /** Ids of the jobs to fetch. @type {Set<string>} */
    this.wanted = new Set();
    /** Ids of the jobs that were requested and have not arrived. @type {Set<string>} */
    this.asked = new Set();
    this.turn = 0;
    this.life = new Disposer();
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
  }

  /** Starts to update the list on events. */
  follow() {
    let first = true;
    this.life.add(jobNews.subscribe(() => (first ? (first = false) : this.soon())));
    this.life.add(
      jobs.subscribe((all) => {
        for (const job of all ?? []) this.rows.set(job.id, job);
        this.changed();
      }),
    );
  }

  /** @param {JobQuery} query */
  async ask(query = this.query) {
    this.query = query;
    this.turn += 1;
    const turn = this.turn;
    clearTimeout(this.timer);
    this.timer = undefined;
    const { state: _, sort: __, ...sought } = query;
    try {
      const [ids, tallies] = await Promise.all([getJobIds(query), getTallies(sought)]);
      if (turn !== this.turn) return;
      [this.ids, this.tallies, this.error] = [ids, tallies, null];
    } catch (error) {
      if (turn !== this.turn) return;
      this.error = error instanceof Error ? error.message : String(error);
    }
    this.changed();
  }

  soon() {
    this.timer ??= setTimeout(() => this.ask(), GATHER_MS);
  }

  /** Returns a job, or null and fetches it if it is not loaded. @param {string} id */
  row(id) {
    if (!jobs.value) return null; // the settings' names are not loaded yet either
    const found = this.rows.get(id);
    if (!found && !this.wanted.has(id) && !this.asked.has(id)) {
      if (this.wanted.size === 0) queueMicrotask(() => this.fetch());
      this.wanted.add(id);
    }
    return found ?? null;
  }

  async fetch() {
    const ids = [...this.wanted];
    this.wanted.clear();
    for (const id of ids) this.asked.add(id);
    for (let at = 0; at < ids.length; at += AT_ONCE) {
      const some = ids.slice(at, at + AT_ONCE);
      try {
        for (const job of await getJobsOf(some)) this.rows.set(job.id, this.rows.get(job.id) ?? job);
      } catch {
        // The banner shows that the service does not respond; the rows are requested again when they are shown again.
      }
      for (const id of some.filter((each) => this.rows.has(each))) this.asked.delete(id);
      const missing = some.filter((id) => this.asked.has(id));
      // Deleted meanwhile, or the service does not respond: retried later.
      if (missing.length) setTimeout(() => missing.forEach((id) => this.asked.delete(id)), AGAIN_MS);
      this.changed();
    }
  }

  dispose() {
    this.turn += 1;
    clearTimeout(this.timer);
    this.life.dispose();
  }
}

/** Number of jobs in each state; null until known. @type {Store<Tallies | null>} */
export const tallies = new Store(/** @type {Tallies | null} */ (null));

/** Starts to update the tallies on events. */
export function followTallies() {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  let turn = 0;
  const look = () => {
    timer = undefined;
    turn += 1;
    const own = turn;
    getTallies({}).then(
      (found) => own === turn && tallies.set(found), // answers may overtake one another
      () => (timer ??= setTimeout(look, AGAIN_MS)),
    );
  };
  jobNews.subscribe(() => (timer ??= setTimeout(look, GATHER_MS)));
}

/** @typedef {{id: string, state: JobState, priority: number}} Was a job before it was changed */
/** @typedef {{state?: "running" | "paused" | "cancelled" | "deleted", priority?: number, of?: JobState[]}} Change */

/** Maximum number of jobs per request. */
const MOST = 1000;

/**
 * Changes many jobs.
 *
 * @param {string[]} ids
 * @param {Change} change
 * @returns {Promise<{changed: Was[], refused: {id: string, why: string}[]}>}
 */
export async function changeMany(ids, change) {
  /** @type {Was[]} */
  const changed = [];
  /** @type {{id: string, why: string}[]} */
  const refused = [];
  for (let at = 0; at < ids.length; at += MOST) {
    const answer = await changeJobs(ids.slice(at, at + MOST), change);
    changed.push(...answer.changed);
    refused.push(...answer.refused);
  }
  return { changed, refused };
}

/** Restores the previous state of jobs. @param {Was[]} before */
export async function restore(before) {
  /** @type {Map<string, {ids: string[], steps: Change[]}>} */
  const groups = new Map();
  for (const { id, state, priority } of before) {
    const key = `${state} ${priority}`;
    const group = groups.get(key) ?? { ids: [], steps: stepsTo(state, priority) };
    groups.set(key, group);
    group.ids.push(id);
  }
  for (const { ids, steps } of groups.values()) for (const step of steps) await changeMany(ids, step);
}

/** @param {JobState} state @param {number} priority @returns {Change[]} */
function stepsTo(state, priority) {
  if (state === "queued" || state === "running") return [{ state: "running", priority }];
  // A cancelled job can only be paused after it was resumed.
  if (state === "paused") return [{ state: "running", of: ["cancelled"] }, { state: "paused", priority }];
  return [{ state: "cancelled", of: ["queued", "running", "paused"] }, { priority }];
}
