/** The content of the view's area: the live view, or picture A, optionally with B beside it at a wipe. */

import { jobs } from "../news/farm.js";
import { here, onParams, setParams } from "../shell/router.js";
import { Store } from "../base/store.js";

/** @typedef {import("../base/types.js").Job} Job */

/** Stands for the live view instead of a job's id. */
export const LIVE = "live";

/**
 * @typedef {object} Sides
 * @property {string} a LIVE or a job
 * @property {string} b likewise; "" for nothing
 */

/** @param {URLSearchParams} params @returns {Sides} */
const fromUrl = (params) => ({ a: params.get("a") || LIVE, b: params.get("b") || "" });

/** Whether there is more than the live view alone. @param {Sides} sides */
export const isCompared = ({ a, b }) => a !== LIVE || b !== "";

/** @param {Sides} sides @param {string} id @returns {Sides} with it as A; again: without */
export const asA = ({ a, b }, id) => clean({ a: a === id ? LIVE : id, b });

/** @param {Sides} sides @param {string} id @returns {Sides} with it as B, beside A or the live view; again: without */
export const asB = ({ a, b }, id) => clean({ a, b: b === id ? "" : id });

/** Removes B if it equals A. @param {Sides} sides @returns {Sides} */
export const clean = ({ a, b }) => ({ a, b: a === b ? "" : b });

/** @param {string} id @returns {Job | null} one with a picture to show */
export const jobOf = (id) => (jobs.value ?? []).find((job) => job.id === id && job.width) ?? null;

/**
 * @param {import("../base/store.js").Disposer} life
 * @returns {Store<Sides>} initialized from the URL, and written back to it
 */
export function sidesFromUrl(life) {
  const store = new Store(fromUrl(here().params));
  const path = here().path.join();
  let isFirst = true;
  store.subscribe((sides) => {
    if (isFirst || here().path.join() !== path) return void (isFirst = false);
    setParams({ a: sides.a === LIVE ? null : sides.a, b: sides.b || null, ...(!isCompared(sides) && { at: null }) });
  });
  life.add(
    onParams(() => {
      const next = fromUrl(here().params);
      if (next.a !== store.value.a || next.b !== store.value.b) store.set(next);
    }),
  );
  return store;
}
