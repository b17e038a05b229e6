/** Snapshots of the compared jobs, reloaded while they run. */

import { getSnapshots } from "../news/api.js";
import { Store } from "../base/store.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").Snapshot} Snapshot */

const RENEW_MS = 5000;

/**
 * @param {() => (Job | null)[]} jobs
 * @param {import("../base/store.js").Disposer} life
 * @returns {{of: Store<Record<string, Snapshot[]>>, renew: () => void}} of: by job
 */
export function snapshotsOf(jobs, life) {
  const of = new Store(/** @type {Record<string, Snapshot[]>} */ ({}));
  const abort = new AbortController();
  life.add(() => abort.abort());
  /** State of each job at the latest request, by job id. @type {Record<string, string>} */
  const asked = {};
  const ask = async (/** @type {Job} */ { id, state }) => {
    asked[id] = state;
    try {
      const found = await getSnapshots(id, abort.signal);
      if (JSON.stringify(found) !== JSON.stringify(of.value[id])) of.set({ ...of.value, [id]: found });
    } catch {
      // Connection lost or job deleted, as shown elsewhere.
    }
  };
  const renew = () => {
    for (const job of new Set(jobs())) if (job && asked[job.id] !== job.state) void ask(job);
  };
  life.every(RENEW_MS, () => {
    for (const job of new Set(jobs())) if (job?.state === "running") void ask(job);
  });
  renew();
  return { of, renew };
}
