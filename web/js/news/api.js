/** The REST API, one function per call. Failures are an `ApiError` with the service's message. */

import { readMesh } from "./mesh-packet.js";
import { decodeFilm } from "./tile-packet.js";
import { fetchWithRetries } from "./busy.js";
import { inProject } from "../base/project.js";
import { said } from "../base/said.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").JobRequest} JobRequest */
/** @typedef {import("../base/types.js").Worker} Worker */
/** @typedef {import("../base/types.js").Info} Info */
/** @typedef {import("../base/types.js").Example} Example */
/** @typedef {import("../base/types.js").PixelValue} PixelValue */
/** @typedef {import("../base/types.js").Frame} Frame */
/** @typedef {import("../base/types.js").Environment} Environment */

/**
 * @typedef {object} JobChange of frames as text: 10-20 or 7,9
 * @property {"running" | "paused" | "cancelled"} [state]
 * @property {string[]} [after] the jobs that it still waits for
 * @property {string | null} [deadline] an ISO time
 * @property {number | null} [max_slots]
 * @property {string[]} [needs]
 * @property {number} [priority]
 * @property {number} [spp]
 * @property {number} [more]
 * @property {string} [frames] that spp or more are for
 * @property {string} [extend]
 * @property {string} [again]
 * @property {number} [first] -1: none
 * @property {string} [order]
 * @property {[number, number, number, number] | null} [focus] x, y, w, h that is rendered first
 * @property {boolean} [pinned] kept, whatever its age
 * @property {string} [name] empty: as its scene
 * @property {string} [note] empty: none
 */

export class ApiError extends Error {
  /**
   * @param {number} status HTTP status; 0 where the service did not answer
   * @param {string} message a sentence for a person
   */
  constructor(status, message) {
    super(message);
    this.status = status;
  }
}

const NO_ANSWER = t("The service does not answer. Is it still running? `python3 farm.py up` starts it.");

/**
 * Extracts the message of an error response: RFC 9457's `detail`, or the status if something else than the service answered.
 *
 * @param {number} status
 * @param {string} body
 * @returns {ApiError}
 */
export function errorOf(status, body) {
  if (status === 0) return new ApiError(0, NO_ANSWER);
  try {
    const problem = JSON.parse(body);
    const sentence = problem.detail ?? problem.title;
    if (typeof sentence === "string" && sentence) return new ApiError(status, said(sentence, problem));
  } catch {
    // Not JSON: the response of a proxy between the page and the service.
  }
  return new ApiError(status, t("The service answered with status {status}.", { status }));
}

/**
 * @param {string} method
 * @param {string} path
 * @param {{json?: unknown, headers?: Record<string, string>, signal?: AbortSignal, keepalive?: boolean}} [options]
 * @returns {Promise<any>}
 */
export async function call(method, path, options) {
  return (await answerOf(method, path, options)).data;
}

/**
 * @param {string} method
 * @param {string} path
 * @param {{json?: unknown, headers?: Record<string, string>, signal?: AbortSignal, keepalive?: boolean}} [options]
 * @returns {Promise<{data: any, total: number}>} total: length of the whole list, for a paginated list
 */
async function answerOf(method, path, { json, headers = {}, signal, keepalive } = {}) {
  let response;
  try {
    response = await fetch(`api${path}`, {
      method,
      headers: json === undefined ? headers : { ...headers, "Content-Type": "application/json" },
      body: json === undefined ? undefined : JSON.stringify(json),
      signal,
      keepalive,
    });
  } catch (error) {
    if (signal?.aborted) throw error;
    throw new ApiError(0, NO_ANSWER);
  }
  const text = await response.text();
  if (!response.ok) throw errorOf(response.status, text);
  return { data: text ? JSON.parse(text) : null, total: Number(response.headers.get("X-Total-Count") ?? 0) };
}

/**
 * @template T
 * @typedef {{items: T[], total: number}} Page some of a list, and how many there are
 */

const PAGE = 100;
const MOST = 1000; // maximum number of items per response

/** @param {string} path @param {number} offset how many come before @returns {Promise<Page<any>>} */
export async function getPage(path, offset = 0) {
  const { data, total } = await answerOf("GET", `${path}${path.includes("?") ? "&" : "?"}limit=${PAGE}&offset=${offset}`);
  return { items: data, total };
}

/** Fetches all pages of a list. @param {string} path @returns {Promise<any[]>} */
export async function getAll(path) {
  const found = [];
  let page;
  do {
    page = await answerOf("GET", `${path}?limit=${MOST}&offset=${found.length}`);
    found.push(...page.data);
  } while (page.data.length && found.length < page.total);
  return found;
}

export const UPLOAD_URL = "api/scenes";

/** @returns {Promise<Scene[]>} newest first */
export const getScenes = () => call("GET", inProject("/scenes"));

/** @param {string} text words of their names, or the begin of an id; empty: all @returns {Promise<Scene[]>} newest first, many more than `getScenes` tells */
export const findScenes = (text) => call("GET", inProject(`/scenes?${new URLSearchParams({ limit: "1000", ...(text && { search: text }) })}`));

/** @param {string} id @returns {Promise<Scene>} */
export const getScene = (id) => call("GET", `/scenes/${id}`);

/** @param {string} id @returns {Promise<void>} */
export const deleteScene = (id) => call("DELETE", `/scenes/${id}`);

/** @returns {Promise<Job[]>} newest first */
export const getJobs = () => call("GET", inProject("/jobs"));

/** @param {string} text @param {number} most @returns {Promise<Job[]>} the latest whose name, note or scene has the text */
export const findJobs = (text, most) => call("GET", inProject(`/jobs?${new URLSearchParams({ limit: String(most), search: text })}`));

/** @param {import("./job-list.js").JobQuery} query @returns {Promise<string[]>} in order */
export const getJobIds = (query) => call("GET", inProject(`/jobs/ids${listText(query)}`));

/** @param {string[]} ids @returns {Promise<Job[]>} those that are there, in no order */
export const getJobsOf = (ids) => call("GET", `/jobs?limit=${ids.length}&ids=${ids.join(",")}`);

/** @param {import("./job-list.js").JobQuery} query @returns {Promise<import("./job-list.js").Tallies>} */
export const getTallies = (query) => call("GET", inProject(`/jobs/tallies${listText(query)}`));

/**
 * @param {string[]} ids
 * @param {import("./job-list.js").Change} change
 * @returns {Promise<{changed: import("./job-list.js").Was[], refused: {id: string, why: string}[]}>}
 */
export const changeJobs = (ids, change) =>
  call("POST", "/jobs/changes", { json: { jobs: ids, ...change }, keepalive: change.state === "deleted" });

/** @param {import("./job-list.js").JobQuery} query */
function listText(query) {
  const pairs = Object.entries(query).flatMap(([name, value]) => [value ?? []].flat().map((each) => [name, each]));
  const text = new URLSearchParams(pairs).toString();
  return text && `?${text}`;
}

/** @param {string} id @returns {Promise<Job>} */
export const getJob = (id) => call("GET", `/jobs/${id}`);

/**
 * @param {JobRequest} request
 * @param {string} idempotencyKey a repeated POST with the same key makes one job
 * @returns {Promise<Job>}
 */
export const createJob = (request, idempotencyKey) =>
  call("POST", "/jobs", { json: request, headers: { "Idempotency-Key": idempotencyKey } });

/** @param {string} id @param {JobChange} change @returns {Promise<Job>} */
export const changeJob = (id, change) => call("PATCH", `/jobs/${id}`, { json: change });

/**
 * Requests the same picture in a new job from the first sample, and cancels this one.
 * @param {string} id
 * @returns {Promise<Job>}
 */
export const beginAnew = (id) => call("POST", `/jobs/${id}/anew`);

/** @param {number} offset @returns {Promise<Page<Environment>>} presets, then uploaded environments, newest first */
export const getEnvironments = (offset) => getPage(inProject("/environments"), offset);

/** @param {string} id @returns {Promise<void>} */
export const removeEnvironment = (id) => call("DELETE", `/environments/${id}`);

/** @param {number} offset @returns {Promise<Page<import("../base/types.js").Reference>>} newest first */
export const getReferences = (offset) => getPage(inProject("/references"), offset);

/** @param {string} id @returns {Promise<import("../base/types.js").Reference>} */
export const getReference = (id) => call("GET", `/references/${id}`);

/** @param {string} id @returns {Promise<void>} */
export const removeReference = (id) => call("DELETE", `/references/${id}`);

/** @param {string} id @param {string} file film, file or image.exr and the like */
export const referenceUrl = (id, file) => `api/references/${id}/${file}`;

/** @param {string} job @param {AbortSignal} [signal] @returns {Promise<import("../base/types.js").Snapshot[]>} in order */
export const getSnapshots = (job, signal) => call("GET", `/jobs/${job}/snapshots`, { signal });

/** @param {string} job @param {number} spp @param {string} file film, or image.exr and the like */
export const snapshotUrl = (job, spp, file) => `api/jobs/${job}/snapshots/${spp}/${file}`;

/** @returns {Promise<Worker[]>} */
export const getWorkers = () => call("GET", "/workers");

/** @param {string} name @param {"running" | "paused"} state @returns {Promise<Worker>} */
export const changeWorker = (name, state) => call("PATCH", `/workers/${encodeURIComponent(name)}`, { json: { state } });

/**
 * @param {string} name
 * @param {{hours?: string | null, idle_minutes?: number | null, slots?: number | null, memory_gb?: number | null, nice?: number | null}} terms
 *     null: as it was started
 * @returns {Promise<Worker>} as it is until it obeys
 */
export const askWorker = (name, terms) => call("PATCH", `/workers/${encodeURIComponent(name)}`, { json: terms });

/** @param {string} name @returns {Promise<string[]>} its last lines */
export const getWorkerLog = (name) => call("GET", `/workers/${encodeURIComponent(name)}/log`);

/** @returns {Promise<import("../base/types.js").Joining>} */
export const getJoining = () => call("GET", "/joining");

/** @type {Promise<Info> | null} */
let info = null;

/** Fetches the formats and settings that the service accepts, which another release may have changed. @returns {Promise<Info>} */
export function renewInfo() {
  const asked = (info = call("GET", "/info"));
  asked.catch(() => info === asked && (info = null));
  return asked;
}

/** Returns them as they were fetched last. @returns {Promise<Info>} */
export const getInfo = () => info ?? renewInfo();

/** @returns {Promise<Example[]>} */
export const getExamples = () => call("GET", "/examples");

/** A section of a guide. guide: the guide's title. @typedef {{guide: string, heading: string, url: string}} GuideSection */

/** @returns {Promise<GuideSection[]>} */
export async function getGuides() {
  const answer = await fetch("docs/guides/search.json");
  if (!answer.ok) throw errorOf(answer.status, await answer.text());
  /** @type {{guide: string, title: string, heading: string, anchor: string}[]} */
  const sections = await answer.json();
  return sections.map(({ guide, title, heading, anchor }) => ({ guide: title, heading, url: `docs/guides/${guide}${anchor && `#${anchor}`}` }));
}

/** @param {string} name @returns {Promise<Scene>} the scene that the example became */
export const openExample = (name) => call("POST", inProject(`/examples/${encodeURIComponent(name)}`));

/**
 * A job's history. Seconds are of rendering; events are at unix times.
 *
 * @typedef {{points: {seconds: number, spp: number, noise: number | null}[], events: {at: number, kind: string, words: string}[]}} History
 */

/** @param {string} id @param {AbortSignal} signal @returns {Promise<History>} */
export const getHistory = (id, signal) => call("GET", `/jobs/${id}/history`, { signal });

/** @param {string} id @param {AbortSignal} signal @returns {Promise<string>} */
export async function getJobLog(id, signal) {
  const answer = await fetch(jobLogUrl(id), { signal });
  if (!answer.ok) throw errorOf(answer.status, await answer.text());
  return answer.text();
}

/**
 * Fetches the log of the tile that contains a pixel.
 * @param {Place} place
 * @param {{x: number, y: number}} pixel
 * @param {AbortSignal} signal
 * @returns {Promise<string>}
 */
export async function getTileLog({ job, frame }, { x, y }, signal) {
  const answer = await fetch(`api/jobs/${job}/frames/${frame}/log?x=${x}&y=${y}`, { signal });
  if (!answer.ok) throw errorOf(answer.status, await answer.text());
  return answer.text();
}

/** @param {string} id */
export const jobLogUrl = (id) => `api/jobs/${id}/log`;

/** A frame of a job. @typedef {{job: string, frame: number}} Place */

/**
 * @param {Place} place
 * @param {AbortSignal} signal
 * @returns {Promise<import("../base/types.js").FrameWorkers>}
 */
export const getFrameWorkers = ({ job, frame }, signal) => call("GET", `/jobs/${job}/frames/${frame}/workers`, { signal });

/**
 * @param {Place} place
 * @param {number} x
 * @param {number} y
 * @param {AbortSignal} signal
 * @returns {Promise<PixelValue>}
 */
export const getPixel = ({ job, frame }, x, y, signal) =>
  call("GET", `/jobs/${job}/frames/${frame}/pixel?x=${x}&y=${y}`, { signal });

/**
 * @param {Place} place
 * @param {number} x
 * @param {number} y
 * @param {number | null} sample one more that is to be shown
 * @param {AbortSignal} signal
 * @returns {Promise<import("../base/types.js").Explained>}
 */
export const explainPixel = ({ job, frame }, x, y, sample, signal) =>
  call("GET", `/jobs/${job}/explain${queryText({ x, y, frame, ...(sample == null ? {} : { sample }) })}`, { signal });

/** @param {string} scene */
export const thumbnailUrl = (scene) => `api/scenes/${scene}/thumbnail.png`;

/** Returns the URL of a scene's poster; "" if it has none. @param {import("../base/types.js").Scene} scene */
export const posterUrl = ({ poster }) => (poster ?? "").replace(/^\//, "");

/**
 * @param {Place} place
 * @param {"png" | "exr" | "jpg" | "avif" | "jxl" | "rgb9e5"} format
 * @param {Record<string, string | number>} [query] aov, exposure, tonemap, …
 */
export function imageUrl({ job, frame }, format, query = {}) {
  return `api/jobs/${job}/frames/${frame}/image.${format}${queryText(query)}`;
}

/** @param {Place} place */
export const deepUrl = ({ job, frame }) => `api/jobs/${job}/frames/${frame}/deep.exr`;

/**
 * The format of small pictures of a job: PNG has the alpha of a transparent background, which the style sheets show before squares.
 *
 * @param {import("../base/types.js").Job | null | undefined} job
 * @returns {"png" | "jpg"}
 */
export const thumbnailFormat = (job) => (job?.settings?.["background"] === "transparent" ? "png" : "jpg");

/** @param {Record<string, string | number>} query */
function queryText(query) {
  const text = new URLSearchParams(Object.entries(query).map(([k, v]) => [k, String(v)])).toString();
  return text && `?${text}`;
}

/**
 * URL of a file with many frames.
 *
 * @param {string} job
 * @param {"frames.zip" | "movie.mp4" | "movie.webm"} file
 * @param {Record<string, string | number>} query
 */
export const shotUrl = (job, file, query) => `api/jobs/${job}/${file}${queryText(query)}`;

/**
 * @param {Place} place
 * @param {Parameters<typeof imageUrl>[1]} format
 * @param {Record<string, string | number>} query
 * @param {AbortSignal} signal
 */
async function fetchPicture(place, format, query, signal) {
  const response = await fetchWithRetries(imageUrl(place, format, query), { signal });
  if (!response.ok) throw errorOf(response.status, await response.text());
  return response;
}

/**
 * Fetches a plane of the film as a displayable picture, with its number of samples over all pixels.
 *
 * @param {Place} place
 * @param {Record<string, string | number>} query
 * @param {AbortSignal} signal
 * @returns {Promise<{image: ImageBitmap, samples: number, span: [number, number] | null}>} span: of a heat map
 */
export async function fetchImage(place, query, signal) {
  const response = await fetchPicture(place, "png", query, signal);
  const options = /** @type {const} */ ({ colorSpaceConversion: "none", premultiplyAlpha: "none" });
  const span = response.headers.get("X-Span")?.split(",").map(Number);
  return {
    image: await createImageBitmap(await response.blob(), options),
    samples: samplesOf(response),
    span: span ? [span[0] ?? 0, span[1] ?? 0] : null,
  };
}

/**
 * Fetches a picture as linear light: RGB9E5 words, rows from the top, with its number of samples over all pixels.
 *
 * @param {Place} place
 * @param {Record<string, string | number>} query
 * @param {AbortSignal} signal
 * @returns {Promise<{words: Uint32Array, samples: number, isPreview: boolean}>}
 */
export async function fetchWords(place, query, signal) {
  const response = await fetchPicture(place, "rgb9e5", query, signal);
  const isPreview = response.headers.get("X-Preview") === "true";
  return { words: new Uint32Array(await response.arrayBuffer()), samples: samplesOf(response), isPreview };
}

/**
 * Fetches a frame's whole film: its light, and the samples of each tile.
 *
 * @param {Place} place
 * @param {AbortSignal} signal
 * @returns {Promise<import("./tile-packet.js").FilmPacket>}
 */
export const fetchFilm = ({ job, frame }, signal) => fetchPacket(`api/jobs/${job}/frames/${frame}/film`, signal);

/**
 * Fetches a film packet from any URL.
 *
 * @param {string} url
 * @param {AbortSignal} signal
 * @returns {Promise<import("./tile-packet.js").FilmPacket>}
 */
export async function fetchPacket(url, signal) {
  const response = await fetchWithRetries(url, { signal });
  if (!response.ok) throw errorOf(response.status, await response.text());
  return decodeFilm(await response.arrayBuffer());
}

/** Fetches the table of an OpenColorIO view. @param {string} name @returns {Promise<ArrayBuffer>} */
export async function fetchViewTable(name) {
  const response = await fetchWithRetries(`api/view-table${queryText({ tonemap: name })}`, {});
  if (!response.ok) throw errorOf(response.status, await response.text());
  return await response.arrayBuffer();
}

/** Fetches a scene's preview mesh. @param {string} scene @param {AbortSignal} signal @returns {Promise<import("./mesh-packet.js").MeshPacket>} */
export async function fetchMesh(scene, signal) {
  const response = await fetchWithRetries(`api/scenes/${scene}/preview`, { signal });
  if (!response.ok) throw errorOf(response.status, await response.text());
  return readMesh(/** @type {ReadableStream<Uint8Array>} */ (response.body));
}

/**
 * Fetches the light of a scene's preview mesh in another environment; null: the service does not have it yet.
 *
 * @param {string} scene
 * @param {Record<string, any>} request a view's
 * @param {AbortSignal} signal
 * @returns {Promise<import("../scene/chosen-light.js").SentLight | null>}
 */
export async function fetchPreviewLight(scene, { environment: { preset, sky, image } = {}, variant, up, floor }, signal) {
  const fields = Object.entries({ preset, ...sky, image, variant, up, floor }).filter(([, value]) => value != null);
  const response = await fetchWithRetries(`api/scenes/${scene}/preview-light?${new URLSearchParams(fields.map(([name, value]) => [name, String(value)]))}`, { signal });
  if (!response.ok) throw errorOf(response.status, await response.text());
  return response.json();
}

/** @param {Response} response */
const samplesOf = (response) => Number(response.headers.get("X-Samples"));
