/** What few change: when to stop early, how light is found, how samples are spread, the environment. */

import { h } from "./dom.js";
import { environmentFields } from "./environment-fields.js";
import { choiceField, field, numberInput, setShown } from "./fields.js";
import { DEFAULTS, FILTERS, HEURISTICS, LIGHT_CHOICES, MISTAKES, SAMPLERS, SAMPLINGS } from "./render-choices.js";

/** @typedef {import("./types.js").JobRequest} JobRequest */

/**
 * What a picture was asked to be beside the renderer's own settings.
 *
 * @typedef {object} Beside
 * @property {number | null} [noise] relative
 * @property {number | null} [seconds]
 * @property {import("./types.js").Vec3 | null} [environment]
 * @property {number} [environment_strength]
 */

/**
 * What an integrator looks at; the rest is not shown, and not sent.
 *
 * @type {Record<string, (keyof typeof DEFAULTS)[]>}
 */
const READ_BY = {
  path: [
    "max_depth",
    "sampling",
    "heuristic",
    "light_choice",
    "light_samples",
    "roulette",
    "roulette_floor",
    "clamp_indirect",
    "mistake",
  ],
  direct: ["sampling", "heuristic", "light_choice", "light_samples", "roulette", "mistake"],
  whitted: ["max_depth", "light_choice", "light_samples", "ambient", "mistake"],
  ao: ["ao_distance"],
};

/**
 * @param {Record<string, any>} defaults what the scene file asks for
 * @param {Record<string, any>} [first] what the fields show first, where that is something else
 * @returns {{element: HTMLDetailsElement, show: (integrator: string) => void, get: () => Partial<JobRequest>}}
 */
export function advancedFields(defaults, first = {}) {
  const own = { ...DEFAULTS, ...defaults };
  /** @type {typeof own & Beside} */
  const start = { ...own, ...first };
  const noise = numberInput({
    value: start.noise ? start.noise * 100 : "",
    min: 0.01,
    max: 1000,
    step: "any",
    required: false,
    placeholder: "off",
  });
  const seconds = numberInput({
    value: start.seconds ?? "",
    min: 1,
    max: 1e7,
    step: "any",
    required: false,
    placeholder: "off",
  });
  const depth = numberInput({ value: start.max_depth, min: 1, max: 1024 });
  const seed = numberInput({ value: start.seed, min: 0, max: 2 ** 32 - 1 });
  const lightSamples = numberInput({ value: start.light_samples, min: 1, max: 64 });
  const roulette = optional(start.roulette || null, { min: 0.05, max: 1, placeholder: "by throughput" });
  const floor = optional(start.roulette_floor || null, { min: 0, max: 0.95, placeholder: "none" });
  const clamp = optional(start.clamp_indirect || null, { min: 0, max: 1e9, placeholder: "off" });
  const distance = optional(start.ao_distance || null, { min: 0, max: 1e15, placeholder: "no limit" });
  const ambient = numberInput({ value: start.ambient[0], min: 0, max: 1e9, step: "any" });
  const environment = environmentFields(start);
  const sampling = choiceField("Finding lights", SAMPLINGS, start.sampling);
  const heuristic = choiceField("Weighed by", HEURISTICS, start.heuristic);
  const lightChoice = choiceField("Choice among lights", LIGHT_CHOICES, start.light_choice);
  const mistake = choiceField("Mistake on purpose", MISTAKES, start.mistake);
  const sampler = choiceField("Sampler", SAMPLERS, start.sampler);
  const filter = choiceField("Pixel filter", FILTERS, start.filter);

  /** Settings with a field of their own, and that field. @type {Partial<Record<keyof typeof DEFAULTS, HTMLElement>>} */
  const fields = {
    max_depth: field("Max depth", depth, "Path segments, the camera's included."),
    light_samples: field(
      "Light samples",
      lightSamples,
      "Shadow rays where the camera looks; in Whitted's way, 1 is a sharp shadow.",
    ),
    roulette: field(
      "Roulette",
      roulette,
      "The chance with which a path goes on at each bounce; empty: as much as it still carries.",
    ),
    roulette_floor: field("Least chance", floor, "With which a path goes on, where it is by what it carries."),
    clamp_indirect: field("Indirect clamp", clamp, "Cuts fireflies from bounced light, and some light with them."),
    ao_distance: field("AO distance", distance, "What is farther away than this does not occlude."),
    ambient: field("Ambient light", ambient, "A constant in place of all light from wall to wall."),
    sampling: sampling.element,
    heuristic: heuristic.element,
    light_choice: lightChoice.element,
    mistake: mistake.element,
  };
  /** The current values of what has a field. */
  const values = () => ({
    max_depth: depth.valueAsNumber,
    light_samples: lightSamples.valueAsNumber,
    roulette: valueOr(roulette, 0),
    roulette_floor: valueOr(floor, 0),
    clamp_indirect: valueOr(clamp, 0),
    ao_distance: valueOr(distance, 0),
    // A grey, unless the scene's own colour is left as it is.
    ambient: ambient.valueAsNumber === start.ambient[0] ? start.ambient : Array(3).fill(ambient.valueAsNumber),
    sampling: sampling.get(),
    heuristic: heuristic.get(),
    light_choice: lightChoice.get(),
    mistake: mistake.get(),
  });
  let integrator = start.integrator;
  const isRead = (/** @type {string} */ name) =>
    (READ_BY[integrator] ?? []).includes(/** @type {keyof typeof DEFAULTS} */ (name));
  /** @param {string} next */
  const show = (next) => {
    integrator = next;
    for (const [name, element] of Object.entries(fields)) setShown(element, isRead(name));
  };
  show(integrator);

  /** @param {string} title @param {...HTMLElement} content */
  const group = (title, ...content) =>
    h("fieldset", { class: "group" }, h("legend", null, title), h("div", { class: "pairs" }, content));
  const element = h(
    "details",
    null,
    h("summary", null, "Advanced"),
    h(
      "div",
      { class: "stack" },
      group(
        "Stop early",
        field("At noise, %", noise, "Each tile ends where its error is this small."),
        field("After seconds", seconds, "Whichever comes first ends it."),
      ),
      group("Light", ...Object.values(fields)),
      group(
        "Samples",
        sampler.element,
        filter.element,
        field("Seed", seed, "Another seed, other noise; the same seed, the same bits."),
      ),
      group("Environment", ...environment.elements),
    ),
  );
  return {
    element,
    show,
    get: () => ({
      ...(noise.value && { noise: noise.valueAsNumber / 100 }),
      ...(seconds.value && { seconds: seconds.valueAsNumber }),
      ...Object.fromEntries(
        Object.entries(values()).filter(
          ([name, value]) => isRead(name) && String(value) !== String(/** @type {any} */ (own)[name]),
        ),
      ),
      ...(sampler.get() !== own.sampler && { sampler: sampler.get() }),
      ...(filter.get() !== own.filter && { filter: filter.get() }),
      seed: seed.valueAsNumber,
      environment: environment.get(),
    }),
  };
}

/**
 * @param {number | null} value
 * @param {{min: number, max: number, placeholder: string}} options
 */
const optional = (value, options) => numberInput({ ...options, value: value ?? "", step: "any", required: false });

/**
 * @template T
 * @param {HTMLInputElement} input
 * @param {T} empty
 */
const valueOr = (input, empty) => (input.value ? input.valueAsNumber : empty);
