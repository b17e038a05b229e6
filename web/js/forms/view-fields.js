/** A camera by numbers: eye, target, up direction, and lens. */

import { h } from "../base/dom.js";
import { choiceField, explain, field, numberInput, numberOf, setShown } from "./fields.js";
import { numberFor } from "./setting-field.js";
import { isSeen, known, labelOf, settingOf } from "../news/settings-table.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").Setting} Setting */

/** The view of a scene that is not known yet. @type {View} */
export const START = { eye: [0, 0, 5], target: [0, 0, 0], up: [0, 1, 0], fov: 40 };

/**
 * @param {View} [start]
 * @param {(projection: string) => void} [projected]
 * @returns {{place: HTMLDetailsElement, lens: HTMLDetailsElement, get: () => View, set: (view: View) => void, focus: (distance: number) => void, isChanged: () => boolean}}
 *     isChanged: by the user, since it was set
 */
export function viewFields(start = START, projected = () => {}) {
  let base = start;
  const eye = vector(settingOf("view", "eye"));
  const target = vector(settingOf("view", "target"));
  const up = vector(settingOf("view", "up"));
  const lens = known()
    .view.filter(({ type }) => type === "number")
    .map((setting) => {
      const input = numberFor(setting, null);
      return { setting, input, element: field(labelOf(setting), input, setting.help) };
    });
  const inputOf = (/** @type {string} */ name) =>
    /** @type {HTMLInputElement} */ (lens.find(({ setting }) => setting.name === name)?.input);
  const photographic = photographicFields(inputOf("fov"), inputOf("aperture"));
  const focus = /** @type {HTMLInputElement} */ (lens.find(({ setting }) => setting.name === "focus")?.input);
  const { label, choices } = settingOf("view", "projection");
  const projection = choiceField(label, choices ?? [], "perspective", () => chosen());
  const show = () => {
    for (const { setting, element } of lens) setShown(element, isSeen(setting, projection.get()));
    for (const element of photographic.elements) setShown(element, projection.get() === "perspective");
  };
  const chosen = () => (show(), projected(projection.get()));

  /** @param {View} view */
  const set = (view) => {
    const before = projection.get();
    base = view;
    eye.set(view.eye);
    target.set(view.target);
    up.set(view.up);
    projection.set(view.projection ?? "perspective");
    for (const { setting, input } of lens) {
      const value = numberOfView(view, setting);
      input.value = value == null ? "" : String(short(value));
    }
    focus.placeholder = String(short(distance(view)));
    photographic.show();
    show();
    if (projection.get() !== before) projected(projection.get());
  };

  /**
   * Keeps the exact original number if the field still shows its rounded value.
   * @param {HTMLInputElement} input
   * @param {number} exact
   */
  const kept = (input, exact) => (input.value === String(short(exact)) ? exact : numberOf(input, exact));

  /** @returns {View} */
  const get = () => {
    /** @type {View} */
    const view = { ...base, eye: eye.get(base.eye), target: target.get(base.target), up: up.get(base.up) };
    const shape = projection.get();
    view.projection = shape;
    for (const { setting, input } of lens) {
      if (!isSeen(setting, shape)) continue;
      const isLeft = setting.default === null && !input.value;
      Object.assign(view, { [setting.name]: isLeft ? null : kept(input, numberOfView(base, setting) ?? 0) });
    }
    return view;
  };

  set(start);
  const fold = h(
    "details",
    null,
    h("summary", null, t("Lens")),
    h(
      "div",
      { class: "pairs" },
      projection.element,
      photographic.elements,
      lens.map(({ element }) => element),
    ),
  );
  /** The fields' values when they were last set. */
  const unchanged = () => JSON.stringify(get());
  let asSet = unchanged();
  return {
    place: h("details", null, h("summary", null, t("Position")), h("div", { class: "stack" }, eye.element, target.element, up.element)),
    lens: fold,
    get,
    set(view) {
      set(view);
      asSet = unchanged();
    },
    focus(distance) {
      focus.value = String(short(distance));
      for (let open = fold; open; open = /** @type {HTMLDetailsElement} */ (open.parentElement?.closest("details"))) open.open = true; // shows the distance, and the aperture that makes it visible
    },
    isChanged: () => unchanged() !== asSet,
  };
}

/** Sensor of a full-frame camera, in millimetres. */
const SENSOR_MM = { width: 36, height: 24 };

/**
 * Photographic lens fields that mirror the others: focal length for the angle, f-number for the radius. The scene's unit counts
 * as a metre.
 *
 * @param {HTMLInputElement} fov
 * @param {HTMLInputElement} aperture
 */
function photographicFields(fov, aperture) {
  const usual = { min: 0.1, step: /** @type {const} */ ("any"), required: false };
  const length = numberInput({ ...usual, max: 5000 });
  const stop = numberInput({ ...usual, max: 1e6, placeholder: t("all sharp") });
  const lengthOf = () => SENSOR_MM.height / 2 / Math.tan((numberOf(fov, 40) * Math.PI) / 360);
  const show = () => {
    if (document.activeElement !== length) length.value = String(Number(lengthOf().toPrecision(3)));
    const radius = numberOf(aperture, 0);
    if (document.activeElement !== stop) stop.value = radius > 0 ? String(Number((lengthOf() / 2000 / radius).toPrecision(2))) : "";
  };
  const toAperture = () => {
    const number = numberOf(stop, 0);
    aperture.value = number > 0 ? String(short(lengthOf() / 2000 / number)) : "0";
  };
  length.addEventListener("input", () => {
    const mm = numberOf(length, 0);
    if (mm > 0) fov.value = String(short((360 / Math.PI) * Math.atan(SENSOR_MM.height / 2 / mm)));
    if (stop.value) toAperture();
  });
  stop.addEventListener("input", toAperture);
  for (const input of [fov, aperture]) input.addEventListener("input", show);
  return {
    elements: [
      field(t("Focal length, mm"), length, t("For a sensor of {width} × {height} mm.", { width: SENSOR_MM.width, height: SENSOR_MM.height })),
      field(t("f-number"), stop, t("A smaller number blurs more. Scene units are taken to be metres.")),
    ],
    show,
  };
}

/** @param {View} view */
function distance({ eye, target }) {
  return Math.hypot(...eye.map((v, i) => v - (target[i] ?? 0)));
}

/** Returns the height of an orthographic view that shows the target at the same size. @param {View} view */
function heightAtTarget(view) {
  return 2 * distance(view) * Math.tan((view.fov * Math.PI) / 360);
}

/**
 * Returns a view's value of a setting, or the equivalent one if it has none.
 *
 * @param {View} view
 * @param {Setting} setting
 * @returns {number | null}
 */
function numberOfView(view, { name, default: usual }) {
  const own = /** @type {Record<string, any>} */ (view)[name];
  return own ?? (name === "height" ? heightAtTarget(view) : usual);
}

/** @param {Setting} setting */
function vector({ label, minimum, maximum }) {
  const inputs = ["x", "y", "z"].map((axis) =>
    numberInput({ step: "any", min: minimum ?? undefined, max: maximum ?? undefined, label: `${label} ${axis}` }),
  );
  const element = h(
    "div",
    { class: "field", role: "group", "aria-label": label },
    h("span", { class: "label" }, label),
    h("div", { class: "triple" }, inputs),
  );
  explain(element, label, inputs);
  return {
    element,
    /** @param {Vec3} exact what the fields show rounded @returns {Vec3} */
    get: (exact) =>
      /** @type {Vec3} */ (
        inputs.map((input, i) => (input.value === String(short(exact[i] ?? 0)) ? (exact[i] ?? 0) : numberOf(input, 0)))
      ),
    /** @param {Vec3} value */
    set: (value) => inputs.forEach((input, i) => (input.value = String(short(value[i] ?? 0)))),
  };
}

/** Six digits place a camera to a pixel; seventeen would fill the field. @param {number} value */
function short(value) {
  return Number(value.toPrecision(6));
}
