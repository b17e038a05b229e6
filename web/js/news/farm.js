/** The page's state of the farm (scenes, jobs, workers), fetched once and updated by server-sent events. */

import * as api from "./api.js";
import { Backoff } from "../base/backoff.js";
import { isShown } from "../base/project.js";
import { isShot } from "../base/shot-words.js";
import { denoisingTime } from "./denoising-time.js";
import { isOlder } from "./job-order.js";
import { inWords, table } from "./settings-table.js";
import { Store } from "../base/store.js";
import { noteForecast } from "./time-left.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").Worker} Worker */

/** Null until fetched. @type {Store<Scene[] | null>} */
export const scenes = new Store(/** @type {Scene[] | null} */ (null));
/** @type {Store<Job[] | null>} */
export const jobs = new Store(/** @type {Job[] | null} */ (null));
/** @type {Store<Worker[] | null>} */
export const workers = new Store(/** @type {Worker[] | null} */ (null));
/** Names of the connections that are currently lost. @type {Store<ReadonlySet<string>>} */
export const lost = new Store(/** @type {ReadonlySet<string>} */ (new Set()));

/** A counter that increases when the set of jobs or their tallies may have changed. @type {Store<number>} */
export const jobNews = new Store(0);

/** Ids of items deleted by the user that can still be restored. @type {Store<ReadonlySet<string>>} */
export const hidden = new Store(/** @type {ReadonlySet<string>} */ (new Set()));

/**
 * @param {Store<ReadonlySet<string>>} store
 * @param {string} item
 * @param {boolean} member
 */
function setMember(store, item, member) {
  if (store.value.has(item) === member) return;
  const next = new Set(store.value);
  if (member) next.add(item);
  else next.delete(item);
  store.set(next);
}

/** @param {string[]} ids @param {boolean} hide */
export function setAllHidden(ids, hide) {
  const next = new Set(hidden.value);
  for (const id of ids) hide ? next.add(id) : next.delete(id);
  hidden.set(next);
}

/** @param {string} id @param {boolean} hide */
export const setHidden = (id, hide) => setMember(hidden, id, hide);

/** @param {string} connection @param {boolean} up */
export const setLink = (connection, up) => setMember(lost, connection, !up);

/**
 * @template {{id: string, created: number}} T
 * @param {Store<T[] | null>} store newest first
 * @param {T} item replaces the one with its id, or is inserted in order
 */
function put(store, item) {
  store.update((items) => {
    if (!items) return items;
    const at = items.findIndex(({ id }) => id === item.id);
    if (at >= 0) return items.with(at, item);
    const older = items.findIndex(({ created }) => created <= item.created);
    return items.toSpliced(older < 0 ? items.length : older, 0, item);
  });
}

/**
 * Stores a response unless the item is known already, since an event may be newer than the response.
 *
 * @template {{id: string, created: number}} T
 * @param {Store<T[] | null>} store
 * @param {T} item
 * @param {(item: T) => void} put
 */
function adopt(store, item, put) {
  if (!store.value?.some(({ id }) => id === item.id)) put(item);
}

/** @param {Scene} scene */
export const putScene = (scene) => put(scenes, scene);

/** Returns the expected seconds from a job's last sample until its last, denoised picture; 0 for a shot, whose frames are denoised as they end. @param {Job} job */
export function denoisingAfter(job) {
  if (!job.denoise || isShot(job)) return 0;
  const all = scenes.value ?? [];
  return denoisingTime(all.find(({ id }) => id === job.scene), all, workers.value ?? [], (job.width ?? 1) * (job.height ?? 1));
}

/** Stores a description of a job, unless it is older than the known one. @param {Job} job */
export function putJob(job) {
  const before = jobs.value?.find(({ id }) => id === job.id);
  if (isOlder(job, before)) return;
  noteForecast(job, denoisingAfter(job));
  put(jobs, job);
  // Here, since the job's own socket or an answer may bring a new state before the farm's events do.
  if (!before || LISTED.some((name) => before[name] !== job[name])) jobNews.update((n) => n + 1);
}

/** @param {Scene} scene */
export const adoptScene = (scene) => adopt(scenes, scene, putScene);

/** @param {Job} job */
export const adoptJob = (job) => adopt(jobs, job, putJob);

/**
 * @template {{id: string, created: number}} T
 * @param {Store<T[] | null>} store
 * @param {T & {deleted?: boolean}} item
 * @param {(item: T) => void} put
 */
function take(store, item, put) {
  if (item.deleted) store.update((items) => items?.filter(({ id }) => id !== item.id) ?? null);
  else put(item);
}

/** @param {Job & {deleted?: boolean}} job */
function takeJob(job) {
  take(jobs, job, putJob);
  if (job.deleted) jobNews.update((n) => n + 1);
}

/** Fields by which lists are filtered and sorted. */
const LISTED = /** @type {const} */ (["state", "name", "priority"]);

/** @param {Worker & {id: string, deleted?: boolean}} worker */
function takeWorker(worker) {
  workers.update((all) => {
    const name = worker.deleted ? worker.id : worker.name;
    const others = (all ?? []).filter((other) => other.name !== name);
    return worker.deleted ? others : [...others, worker].sort((a, b) => a.name.localeCompare(b.name));
  });
}

const TAKERS = /** @type {Record<string, (item: any) => void>} */ ({
  scene: (item) => isShown(item) && take(scenes, item, putScene),
  job: (item) => isShown(item) && takeJob(item),
  worker: takeWorker,
});

/** Subscribes to the farm's events while the page is open. */
export function followFarm() {
  const backoff = new Backoff();
  const connect = () => {
    const source = new EventSource("api/events");
    /**
     * Events received while the lists were being fetched, applied afterwards since they may be newer.
     * @type {(() => void)[] | null}
     */
    let meanwhile = null;
    for (const [type, take] of Object.entries(TAKERS)) {
      source.addEventListener(type, ({ data }) => {
        const apply = () => take(JSON.parse(data));
        meanwhile?.push(apply);
        apply();
      });
    }
    source.onopen = async () => {
      meanwhile = [];
      try {
        const lists = await Promise.all([api.getScenes(), api.getJobs(), api.getWorkers(), api.renewInfo()]);
        table.set(inWords(lists[3])); // first, since descriptions of jobs and scenes use it
        jobs.set(lists[1]);
        scenes.set(lists[0]); // after the jobs, since a scene's form may start with the settings of a job
        workers.set(lists[2]);
      } catch {
        source.dispatchEvent(new Event("error"));
        return;
      }
      jobNews.update((n) => n + 1);
      for (const apply of meanwhile) apply();
      meanwhile = null;
      backoff.succeeded();
      setLink("events", true);
    };
    source.onerror = () => {
      source.close(); // EventSource reconnects without back-off, and gives up after some responses
      setLink("events", false);
      backoff.schedule(connect);
    };
  };
  connect();
}
