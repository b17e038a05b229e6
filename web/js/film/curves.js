/** The tone curves that can be chosen: those of the shader, and the views of the farm's OpenColorIO config. */

import { h } from "../base/dom.js";
import { t } from "../base/words.js";
import { table } from "../news/settings-table.js";
import { CURVES } from "./tonemap.js";

/** @typedef {import("../base/types.js").DisplayView} DisplayView */

/** @returns {readonly DisplayView[]} */
const views = () => table.value?.views ?? [];

/** @param {string} name @returns {boolean} whether the farm has a view of this name */
export const isView = (name) => views().some((view) => view.name === name);

/** @param {string} name @returns {boolean} */
export const isCurve = (name) => CURVES.some((curve) => curve.name === name) || isView(name);

/**
 * Options for a menu of tone curves: built-in ones, and the views of the config's default display.
 *
 * @param {string} selected offered, too, if it is a view of another display
 * @returns {HTMLElement[]}
 */
export function curveOptions(selected) {
  const offered = views().filter((view) => view.is_default || view.name === selected);
  const displays = [...new Set(offered.map(({ display }) => display))];
  return [
    ...CURVES.map(({ name, label, hint }) => h("option", { value: name, title: hint, selected: name === selected }, label)),
    ...displays.map((display) =>
      h(
        "optgroup",
        { label: t("OCIO: {display}", { display }), translate: "no" }, // names of the config
        offered
          .filter((view) => view.display === display)
          .map(({ name, view }) => h("option", { value: name, selected: name === selected }, view)),
      ),
    ),
  ];
}
