/** In what two jobs differ: for the table beside their comparison, and for what each side is called. */

import { DENOISED, channelOf } from "./channels.js";
import { count } from "./format.js";
import {
  FILTERS,
  HEURISTICS,
  INTEGRATORS,
  LIGHT_CHOICES,
  MISTAKES,
  PROJECTIONS,
  SAMPLERS,
  SAMPLINGS,
  labelOf,
} from "./render-choices.js";

/** @typedef {import("./types.js").Job} Job */
/** @typedef {Record<string, any>} Settings */

/** At most this many differences name a side; the table has all of them. */
const NAMED_BY = 2;

/** What is compared, the most telling first. @type {[string, (settings: Settings, job: Job) => unknown][]} */
const ROWS = [
  ["Scene", (_, job) => job.name],
  ["Integrator", ({ integrator }) => labelOf(INTEGRATORS, integrator)],
  ["Finding lights", ({ sampling }) => labelOf(SAMPLINGS, sampling)],
  ["Weighed by", ({ heuristic }) => labelOf(HEURISTICS, heuristic)],
  ["Choice among lights", ({ light_choice: choice }) => choice && `lights: ${labelOf(LIGHT_CHOICES, choice)?.toLowerCase()}`],
  ["Sampler", ({ sampler }) => labelOf(SAMPLERS, sampler)],
  ["Max depth", ({ max_depth }) => max_depth && `depth ${max_depth}`],
  ["Roulette", ({ roulette }) => (roulette ? `roulette ${roulette}` : "by throughput")],
  ["Least chance", ({ roulette_floor: floor }) => (floor ? `floor ${floor}` : "no floor")],
  ["Light samples", ({ light_samples: n }) => n && `${n} light sample${n === 1 ? "" : "s"}`],
  ["Indirect clamp", ({ clamp_indirect: clamp }) => (clamp ? `clamp ${clamp}` : "no clamp")],
  ["AO distance", ({ ao_distance: d }) => (d ? `AO ${d}` : "no limit")],
  ["Ambient light", ({ ambient }) => ambient && `ambient ${ambient.map(short).join(", ")}`],
  ["Mistake", ({ mistake }) => (mistake ? labelOf(MISTAKES, mistake) : "no mistake")],
  ["Pixel filter", ({ filter }) => labelOf(FILTERS, filter)],
  ["Samples per pixel", (_, { spp, noise }) => (noise == null ? spp && `${count(spp)} spp` : `noise ${noise * 100} %`)],
  ["Seed", ({ seed }) => `seed ${seed}`],
  ["Projection", ({ view }) => labelOf(PROJECTIONS, view?.projection)],
  ["Aperture", ({ view }) => view?.aperture != null && `aperture ${short(view.aperture)}`],
  ["Focus distance", ({ view }) => (view?.focus == null ? "at the target" : `focus ${short(view.focus)}`)],
  ["Near plane", ({ view }) => view?.near != null && `near ${short(view.near)}`],
  ["Camera at", ({ view }) => view?.eye?.map(short).join(", ")],
  ["Environment", ({ environment, environment_strength: strength }) => JSON.stringify([environment, strength])],
  ["Size", (_, { width, height }) => `${width}×${height}`],
];

/** @param {number} value */
const short = (value) => Number(value.toPrecision(4));

/**
 * @param {Job} a
 * @param {Job} b
 * @returns {{label: string, a: string, b: string}[]}
 */
export function differences(a, b) {
  return ROWS.map(([label, read]) => ({
    label,
    a: String(read(a.settings ?? {}, a) || "–"),
    b: String(read(b.settings ?? {}, b) || "–"),
  })).filter((row) => row.a !== row.b);
}

/**
 * What the two sides are called: by what tells them apart.
 *
 * @param {{job: Job, channel: string}} left
 * @param {{job: Job, channel: string}} right
 * @returns {[string, string]}
 */
export function sideNames(left, right) {
  const rows = differences(left.job, right.job).slice(0, NAMED_BY);
  const isDenoised = [left.channel, right.channel].includes(DENOISED);
  const name = (/** @type {"a" | "b"} */ key, /** @type {{job: Job, channel: string}} */ { channel }) => {
    const parts = rows.map((row) => row[key]);
    if (left.channel !== right.channel || parts.length === 0)
      parts.push(isDenoised && channel === "" ? "Raw" : channelOf(channel).label);
    return parts.join(", ");
  };
  return [name("a", left), name("b", right)];
}
