/** The displayed part of the light: all, one channel, luminance, or luminance in false colour, with a legend. */

import { FALSE_STOPS, HEAT, gradient, turboGradient } from "../film/colour-map.js";
import { PARTS } from "../film/film-shader.js";
import { fill, h } from "../base/dom.js";
import { radiance } from "../base/format.js";
import { segments } from "../forms/fields.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/store.js").Store<import("./display-panel.js").Display>} DisplayStore */

const MIDDLE = 0.18;

/** @param {DisplayStore} display */
export function partFields(display) {
  const choice = segments(
    t("Show"),
    PARTS.map(({ name, label }) => ({ value: name, label })),
    (part) => display.update((look) => ({ ...look, part })),
  );
  choice.element.querySelectorAll("label").forEach((label, i) => (label.title = PARTS[i]?.hint ?? ""));
  const bar = h("div", { hidden: true });
  display.subscribe(({ part, exposure }) => {
    choice.select(part);
    bar.hidden = part !== "false";
    const ticks = [-FALSE_STOPS, -FALSE_STOPS / 2, 0, FALSE_STOPS / 2, FALSE_STOPS];
    const words = ticks.map((stop) => [radiance((MIDDLE * 2 ** stop) / 2 ** exposure), `${stop > 0 ? "+" : ""}${stop} EV`]);
    fill(bar, colourBar(t("Luminance, in stops about middle grey"), turboGradient(), words));
  });
  return h("div", { class: "stack tight" }, choice.element, bar);
}

/**
 * A colour bar with labels at equal steps.
 *
 * @param {string} label
 * @param {string} colours CSS
 * @param {(string | undefined)[][]} ticks each a few lines
 */
function colourBar(label, colours, ticks) {
  const strip = h("div", { class: "strip", role: "img", "aria-label": `${label}: ${ticks.map((lines) => lines.join(", ")).join("; ")}` });
  strip.style.background = colours;
  return h(
    "div",
    { class: "colour-bar" },
    strip,
    h(
      "div",
      { class: "ticks number", "aria-hidden": "true" },
      ticks.map((lines) => h("span", null, lines.map((line) => h("span", null, line)))),
    ),
  );
}

/**
 * Legend of a plane's heat map.
 *
 * @param {string} label
 * @param {number} low
 * @param {number} high
 */
export const heatBar = (label, low, high) =>
  colourBar(
    label,
    gradient(HEAT),
    [0, 0.5, 1].map((at) => [radiance(low + at * (high - low))]),
  );
