/** The size of a picture: presets along the longer side with the scene's aspect ratio, or two numbers. */

import { h, setText } from "../base/dom.js";
import { field, numberOf, segments, typeNext } from "./fields.js";
import { CUSTOM, SIZES, sizeOf } from "./render-presets.js";
import { numberFor } from "./setting-field.js";
import { known, settingOf } from "../news/settings-table.js";
import { t } from "../base/words.js";

/** 360 degrees by 180. */
const PANORAMA_ASPECT = 2;

/**
 * @param {Record<string, any>} defaults what the scene file asks for
 * @param {() => void} changed
 * @returns {{elements: HTMLElement[], get: () => {width: number, height: number}, suit: (projection: string) => void}}
 *     suit: takes the shape that a projection needs; what the user typed stays
 */
export function sizeFields(defaults, changed) {
  const { width: across, height: down } = defaults.width && defaults.height ? defaults : known().defaults;
  const start = { width: across, height: down };
  let aspect = start.width / start.height;
  const width = side("width", start.width);
  const height = side("height", start.height);
  const keep = h("input", { type: "checkbox", checked: true });
  const custom = h(
    "div",
    { class: "stack" },
    h("div", { class: "pair" }, field(t("Width"), width), field(t("Height"), height)),
    h("label", { class: "check" }, keep, t("Keep the aspect")),
  );

  /** @param {string} name */
  const choose = (name) => {
    const preset = SIZES.find((size) => size.name === name);
    custom.hidden = preset !== undefined;
    if (preset) show(sizeOf(preset.long, aspect));
    else typeNext(width);
  };
  const choices = [...SIZES.map(({ name, label }) => ({ value: name, label })), { value: CUSTOM, label: t("Custom") }];
  const size = segments(t("Size"), choices, choose);

  const get = () => ({ width: numberOf(width, 0), height: numberOf(height, 0) });
  const tell = () => {
    setText(size.aside, `${get().width} × ${get().height}`);
    changed();
  };
  /** @param {{width: number, height: number}} to */
  const show = (to) => {
    width.value = String(to.width);
    height.value = String(to.height);
    tell();
  };
  /** @param {HTMLInputElement} other @param {() => number} follow what the other side is when the aspect is kept */
  const typed = (other, follow) => () => {
    if (keep.checked) other.value = String(Math.max(1, Math.round(follow())));
    else aspect = numberOf(width, 1) / Math.max(1, numberOf(height, 1));
    tell();
  };
  width.addEventListener(
    "input",
    typed(height, () => numberOf(width, 1) / aspect),
  );
  height.addEventListener(
    "input",
    typed(width, () => numberOf(height, 1) * aspect),
  );

  const preset = SIZES.find(({ long }) => JSON.stringify(sizeOf(long, aspect)) === JSON.stringify(start));
  size.select(preset?.name ?? CUSTOM);
  custom.hidden = preset !== undefined;
  setText(size.aside, `${start.width} × ${start.height}`);
  /** @param {string} projection */
  const suit = (projection) => {
    if (!custom.hidden && !keep.checked) return;
    const { width, height } = get();
    aspect = projection === "panorama" ? PANORAMA_ASPECT : start.width / start.height;
    show(sizeOf(Math.max(width, height), aspect));
  };
  return { elements: [size.element, custom], get, suit };
}

/** @param {"width" | "height"} name @param {number} start */
function side(name, start) {
  const input = numberFor(settingOf("settings", name), start);
  input.required = true;
  return input;
}
