/** A camera by numbers: where it is, what it looks at, which way is up; and its lens. */

import { h } from "./dom.js";
import { choiceField, explain, field, numberInput, numberOf, setShown } from "./fields.js";
import { PROJECTIONS } from "./render-choices.js";

/** @typedef {import("./types.js").View} View */
/** @typedef {import("./types.js").Vec3} Vec3 */

/** @type {View} */
const START = { eye: [0, 0, 5], target: [0, 0, 0], up: [0, 1, 0], fov: 40 };
const LARGEST = 1e15;

/**
 * @param {View} [start]
 * @param {(projection: string) => void} [projected]
 * @returns {{place: HTMLElement, lens: HTMLDetailsElement, get: () => View, set: (view: View) => void, focus: (distance: number) => void, isChanged: () => boolean}}
 *     isChanged: by the user, since it was set
 */
export function viewFields(start = START, projected = () => {}) {
  let base = start;
  const eye = vector("Eye");
  const target = vector("Target");
  const up = vector("Up");
  const projection = choiceField("Projection", PROJECTIONS, "perspective", () => chosen());
  const fov = numberInput({ min: 0.01, max: 179, step: "any" });
  const height = numberInput({ min: 1e-12, max: LARGEST, step: "any" });
  const aperture = numberInput({ min: 0, max: LARGEST, step: "any" });
  const near = numberInput({ min: 0, max: LARGEST, step: "any" });
  const focus = numberInput({ min: 1e-12, max: LARGEST, step: "any", required: false });
  /** The fields of each projection. @type {Record<string, HTMLElement[]>} */
  const of = {
    perspective: [
      field("Field of view, °", fov, "From the picture's lower edge to its upper."),
      field("Aperture", aperture, "The lens's radius in scene units; 0 is sharp everywhere."),
      field("Focus distance", focus, "What lies this far away is sharp; empty: the target."),
    ],
    orthographic: [field("View height", height, "Scene units from the picture's lower edge to its upper.")],
    panorama: [],
  };

  const cut = field("Near plane", near, "What stands before this distance is cut away.");
  const show = () => {
    for (const [name, elements] of Object.entries(of))
      for (const element of elements) setShown(element, name === projection.get());
    setShown(cut, projection.get() !== "panorama");
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
    fov.value = String(short(view.fov));
    height.value = String(short(view.height ?? heightAtTarget(view)));
    aperture.value = String(short(view.aperture ?? 0));
    near.value = String(short(view.near ?? 0));
    focus.value = view.focus == null ? "" : String(short(view.focus));
    focus.placeholder = String(short(distance(view)));
    show();
    if (projection.get() !== before) projected(projection.get());
  };

  /** The base's exact number where the field still shows it, rounded. @param {HTMLInputElement} input @param {number} exact */
  const kept = (input, exact) => (input.value === String(short(exact)) ? exact : numberOf(input, exact));

  /** @returns {View} */
  const get = () => {
    /** @type {View} */
    const view = { ...base, eye: eye.get(base.eye), target: target.get(base.target), up: up.get(base.up) };
    view.projection = projection.get();
    if (view.projection !== "panorama") view.near = kept(near, base.near ?? 0);
    if (view.projection === "orthographic") view.height = kept(height, base.height ?? heightAtTarget(base));
    if (view.projection === "perspective") {
      view.fov = kept(fov, base.fov);
      view.aperture = kept(aperture, base.aperture ?? 0);
      view.focus = focus.value ? kept(focus, base.focus ?? 0) : null;
    }
    return view;
  };

  set(start);
  const lens = h(
    "details",
    null,
    h("summary", null, "Lens"),
    h("div", { class: "pairs" }, projection.element, Object.values(of).flat(), cut),
  );
  /** As the fields had it when they were set. */
  const unchanged = () => JSON.stringify(get());
  let asSet = unchanged();
  return {
    place: h("div", { class: "stack" }, eye.element, target.element, up.element),
    lens,
    get,
    set(view) {
      set(view);
      asSet = unchanged();
    },
    focus(distance) {
      focus.value = String(short(distance));
      lens.open = true; // where the distance, and the aperture that makes it seen, are
    },
    isChanged: () => unchanged() !== asSet,
  };
}

/** @param {View} view */
function distance({ eye, target }) {
  return Math.hypot(...eye.map((v, i) => v - (target[i] ?? 0)));
}

/** What an orthographic camera must show to have the target in the same size. @param {View} view */
function heightAtTarget(view) {
  return 2 * distance(view) * Math.tan((view.fov * Math.PI) / 360);
}

/** @param {string} label */
function vector(label) {
  const inputs = ["x", "y", "z"].map((axis) =>
    numberInput({ step: "any", min: -LARGEST, max: LARGEST, label: `${label} ${axis}` }),
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

/** Six digits place a camera to a pixel; seventeen fill the field. @param {number} value */
function short(value) {
  return Number(value.toPrecision(6));
}
