/** What few change: when to stop early, path depth, seed, environment. */

import { linearOf } from "./colour.js";
import { h } from "./dom.js";
import { field, numberInput } from "./fields.js";

/** @typedef {import("./types.js").JobRequest} JobRequest */

/**
 * @param {Record<string, any>} defaults what the scene file asks for
 * @returns {{element: HTMLDetailsElement, get: () => Pick<JobRequest, "noise" | "seconds" | "max_depth" | "seed" | "environment">}}
 */
export function advancedFields(defaults) {
  const noise = numberInput({ min: 0.01, max: 100, step: "any", required: false, placeholder: "off" });
  const seconds = numberInput({ min: 1, step: "any", required: false, placeholder: "off" });
  const depth = numberInput({ value: defaults.max_depth ?? 8, min: 1, max: 1024 });
  const seed = numberInput({ value: defaults.seed ?? 0, min: 0, max: 2 ** 32 - 1 });
  const strength = numberInput({ value: 1, min: 0, max: 1e6, step: "any" });
  const replace = h("input", { type: "checkbox" });
  const colour = h("input", { type: "color", value: "#ffffff", "aria-label": "Environment colour" });
  colour.disabled = true;
  replace.addEventListener("change", () => (colour.disabled = !replace.checked));

  /** @param {...HTMLElement} fields */
  const pair = (...fields) => h("div", { class: "pair" }, fields);
  const element = h(
    "details",
    null,
    h("summary", null, "Advanced"),
    h(
      "div",
      { class: "stack" },
      pair(
        field("Stop at noise, %", noise, "Ends where the error is this small"),
        field("Stop after, s", seconds, "Whichever comes first ends it"),
      ),
      pair(
        field("Max depth", depth, "Path segments, the camera's included"),
        field("Seed", seed, "Another seed, other noise"),
      ),
      pair(
        field("Environment strength", strength),
        h("div", { class: "field" }, h("label", { class: "check" }, replace, "Replace by colour"), colour),
      ),
    ),
  );
  return {
    element,
    get: () => ({
      ...(noise.value && { noise: noise.valueAsNumber / 100 }),
      ...(seconds.value && { seconds: seconds.valueAsNumber }),
      max_depth: depth.valueAsNumber,
      seed: seed.valueAsNumber,
      environment: { strength: strength.valueAsNumber, color: replace.checked ? linearOf(colour.value) : null },
    }),
  };
}
