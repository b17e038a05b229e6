/**
 * Predefined comparisons of an example: one scene with two settings, opened at the wipe in one click. Defined in
 * web/examples/comparisons.json, by the example's name.
 */

import { ApiError, changeJob, createJob, openExample } from "../news/api.js";
import { adoptJob, adoptScene, putJob } from "../news/farm.js";
import { go } from "../shell/router.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").JobRequest} JobRequest */
/** @typedef {Omit<JobRequest, "scene">} Settings */

/**
 * @typedef {object} ExampleComparison
 * @property {string} title
 * @property {string} [about]
 * @property {Settings} [both] what the two requests share; the scene file's own where left out
 * @property {Settings} left
 * @property {Settings} right
 */

const CONFLICT = 409;

/** @returns {Promise<Record<string, ExampleComparison[]>>} by the example's name */
export async function getComparisons() {
  const response = await fetch(new URL("../../examples/comparisons.json", import.meta.url));
  return response.ok ? response.json() : {};
}

/**
 * Creates both pictures, or finds existing ones, and opens their comparison.
 *
 * @param {string} example
 * @param {ExampleComparison} comparison
 */
export async function openComparison(example, { both = {}, left, right }) {
  const scene = await openExample(example);
  adoptScene(scene);
  const a = await find({ scene: scene.id, ...both, ...left });
  const b = await find({ scene: scene.id, ...both, ...right });
  go("compare", a.id, b.id);
}

/**
 * Returns the job of a request. The idempotency key is derived from the request, so an existing job is reused.
 *
 * @param {JobRequest} request
 * @returns {Promise<Job>}
 */
async function find(request) {
  const key = `comparison-${fingerprint(JSON.stringify(request))}`;
  let job;
  try {
    job = await createJob(request, key);
  } catch (error) {
    // An older release of the service stored the same request differently.
    if (!(error instanceof ApiError) || error.status !== CONFLICT) throw error;
    job = await createJob(request, `${key}-${Date.now()}`);
  }
  adoptJob(job);
  if (job.state === "cancelled" || job.state === "failed") putJob(await changeJob(job.id, { state: "running" }));
  return job;
}

/** 64-bit FNV-1a, since crypto.subtle exists only on HTTPS and localhost. @param {string} text */
function fingerprint(text) {
  let hash = 0xcbf29ce484222325n;
  for (const byte of new TextEncoder().encode(text)) hash = BigInt.asUintN(64, (hash ^ BigInt(byte)) * 0x100000001b3n);
  return hash.toString(16);
}
