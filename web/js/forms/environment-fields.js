/** Light from all around: the scene's own, one colour, or a clear sky with its sun. */

import { hexOf, linearOf } from "../base/colour.js";
import { h } from "../base/dom.js";
import { choiceField, field, numberInput, setShown } from "./fields.js";
import { settingField } from "./setting-field.js";
import { known } from "../news/settings-table.js";

/** @typedef {import("../base/types.js").EnvironmentRequest} EnvironmentRequest */

const CHOICES = [
  { name: "own", label: "The scene's own", help: "As its file says." },
  { name: "color", label: "One colour", help: "The same light from every direction." },
  { name: "sky", label: "Clear sky and sun", help: "A clear day, with the sun where you put it." },
];

/**
 * @param {Record<string, any>} first what the fields show first, where that is not each setting's default
 * @returns {{elements: HTMLElement[], get: () => EnvironmentRequest}} what differs from the scene's own
 */
export function environmentFields(first) {
  const { environment = null } = first;
  const shown = environment ? hexOf(environment) : "#ffffff";
  const colour = h("input", { type: "color", value: shown });
  const elevation = numberInput({ value: 35, min: 0, max: 90, step: "any" });
  const azimuth = numberInput({ value: 0, min: -360, max: 360, step: "any" });
  const numbers = known()
    .settings.filter(({ of, type }) => of === "environment" && type === "number")
    .map((setting) => settingField(setting, first[setting.name] ?? setting.default));
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
      ...numbers.map(({ element }) => element),
    ],
    get: () => ({
      ...Object.fromEntries(
        numbers
          .map(({ setting, get }) => ({ setting, value: get() }))
          .filter(({ setting, value }) => value !== setting.default)
          .map(({ setting, value }) => [setting.name.replace("environment_", ""), value]),
      ),
      ...(kind.get() === "color" && {
        color: environment && colour.value === shown ? environment : linearOf(colour.value),
      }),
      ...(kind.get() === "sky" && { sky: { elevation: elevation.valueAsNumber, azimuth: azimuth.valueAsNumber } }),
    }),
  };
}
