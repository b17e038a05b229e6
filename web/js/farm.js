/** What the page knows of the farm: scenes, jobs and workers, fetched once and kept fresh by server-sent events. */

import * as api from "./api.js";
import { Backoff } from "./backoff.js";
import { Store } from "./store.js";

/** @typedef {import("./types.js").Scene} Scene */
/** @typedef {import("./types.js").Job} Job */
/** @typedef {import("./types.js").Worker} Worker */

/** Null until first fetched. @type {Store<Scene[] | null>} */
export const scenes = new Store(/** @type {Scene[] | null} */ (null));
/** @type {Store<Job[] | null>} */
export const jobs = new Store(/** @type {Job[] | null} */ (null));
/** @type {Store<Worker[] | null>} */
export const workers = new Store(/** @type {Worker[] | null} */ (null));
/** Whether events arrive. @type {Store<boolean>} */
export const link = new Store(true);

/** What the user deleted and may still take back: hidden, not gone. @type {Store<ReadonlySet<string>>} */
export const hidden = new Store(/** @type {ReadonlySet<string>} */ (new Set()));

/**
 * @param {string} id
 * @param {boolean} hide
 */
export function setHidden(id, hide) {
  const next = new Set(hidden.value);
  if (hide) next.add(id);
  else next.delete(id);
  hidden.set(next);
}

/**
 * @template {{id: string}} T
 * @param {Store<T[] | null>} store
 * @param {T} item replaces the one with its id, or comes first
 */
function put(store, item) {
  store.update((items) => {
    if (!items) return items;
    const at = items.findIndex(({ id }) => id === item.id);
    return at < 0 ? [item, ...items] : items.with(at, item);
  });
}

/**
 * @template {{id: string}} T
 * @param {Store<T[] | null>} store
 * @param {string} id
 */
function drop(store, id) {
  store.update((items) => items?.filter((item) => item.id !== id) ?? null);
}

/** @param {Scene} scene */
export const putScene = (scene) => put(scenes, scene);

/** @param {Job} job */
export const putJob = (job) => put(jobs, job);

/** All three again: at the start, and after events were missed. */
async function refetch() {
  const [allScenes, allJobs, allWorkers] = await Promise.all([api.getScenes(), api.getJobs(), api.getWorkers()]);
  scenes.set(allScenes);
  jobs.set(allJobs);
  workers.set(allWorkers);
}

/** @param {MessageEvent<string>} event */
const data = (event) => JSON.parse(event.data);

/** Subscribes to the farm's news for as long as the page is open. */
export function followFarm() {
  const backoff = new Backoff();
  const connect = () => {
    const source = new EventSource("api/events");
    source.onopen = () => {
      refetch().then(
        () => {
          backoff.succeeded();
          link.set(true);
        },
        () => source.dispatchEvent(new Event("error")),
      );
    };
    source.addEventListener("scene", (event) => putScene(data(event)));
    source.addEventListener("scene-deleted", (event) => drop(scenes, data(event).id));
    source.addEventListener("job", (event) => putJob(data(event)));
    source.addEventListener("job-deleted", (event) => drop(jobs, data(event).id));
    source.addEventListener("workers", (event) => workers.set(data(event)));
    source.onerror = () => {
      source.close(); // its own reconnection knows no back-off, and gives up after some answers
      link.set(false);
      backoff.schedule(connect);
    };
  };
  connect();
}
