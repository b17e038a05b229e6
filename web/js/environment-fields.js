/** Light from all around: the scene's own, one colour, or a clear sky with its sun. */

import { hexOf, linearOf } from "./colour.js";
import { h } from "./dom.js";
import { choiceField, field, numberInput, setShown } from "./fields.js";

/** @typedef {import("./types.js").EnvironmentRequest} EnvironmentRequest */

const CHOICES = [
  { name: "own", label: "The scene's own", hint: "As its file says." },
  { name: "color", label: "One colour", hint: "The same light from every direction." },
  { name: "sky", label: "Clear sky and sun", hint: "A clear day, with the sun where you put it." },
];

/**
 * @param {{environment?: import("./types.js").Vec3 | null, environment_strength?: number}} start
 * @returns {{elements: HTMLElement[], get: () => EnvironmentRequest}}
 */
export function environmentFields({ environment = null, environment_strength = 1 }) {
  const shown = environment ? hexOf(environment) : "#ffffff";
  const colour = h("input", { type: "color", value: shown });
  const elevation = numberInput({ value: 35, min: 0, max: 90, step: "any" });
  const azimuth = numberInput({ value: 0, min: -360, max: 360, step: "any" });
  const strength = numberInput({ value: environment_strength, min: 0, max: 1e6, step: "any" });
  /** The fields of each choice. @type {Record<string, HTMLElement[]>} */
  const of = {
    color: [field("Colour", colour)],
    sky: [
      field("Sun's height, °", elevation, "Above the horizon: low is warm, high is white."),
      field("Sun's direction, °", azimuth, "Turns the sun about the vertical."),
    ],
  };
  const show = () => {
    for (const [name, elements] of Object.entries(of))
      for (const element of elements) setShown(element, name === kind.get());
  };
  const kind = choiceField("Light from around", CHOICES, environment ? "color" : "own", show);
  show();
  return {
    elements: [
      kind.element,
      ...Object.values(of).flat(),
      field("Strength", strength, "A factor on the light from all around."),
    ],
    get: () => ({
      strength: strength.valueAsNumber,
      ...(kind.get() === "color" && {
        color: environment && colour.value === shown ? environment : linearOf(colour.value),
      }),
      ...(kind.get() === "sky" && { sky: { elevation: elevation.valueAsNumber, azimuth: azimuth.valueAsNumber } }),
    }),
  };
}
