/** Fields for the up axis of a scene's file, if the file does not state it, and for the studio's floor. */

import { h } from "../base/dom.js";
import { field } from "./fields.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").Scene} Scene */

const AUTO = "auto";

/** Rows of the rotations by which an axis becomes Y, as in renderer/scene/readers/up_axis.py. @type {Record<string, [Vec3, Vec3, Vec3]>} */
const ROTATIONS = {
  y: [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
  z: [[1, 0, 0], [0, 0, 1], [0, -1, 0]],
  x: [[0, -1, 0], [1, 0, 0], [0, 0, 1]],
  "-y": [[1, 0, 0], [0, -1, 0], [0, 0, -1]],
  "-z": [[1, 0, 0], [0, 0, -1], [0, 1, 0]],
  "-x": [[0, -1, 0], [-1, 0, 0], [0, 0, -1]],
};

/**
 * @param {Scene} scene
 * @param {{up?: string | null, floor?: string | null} | null} like what the fields show first, where it is not the scene's own
 * @param {(view: (view: View) => View) => void} turned the user chose another axis: moves a view along with the scene's centre
 * @returns {{elements: HTMLElement[], get: () => {up?: string, floor?: string}, bounds: () => number[][] | null}} bounds: of the scene, with the chosen axis up
 */
export function standFields(scene, like, turned) {
  const own = scene.up ?? AUTO;
  const guessed = scene.up || !scene.up_axis ? t("Auto") : t("Auto: {axis}", { axis: axisName(scene.up_axis) });
  const up = h(
    "select",
    null,
    h("option", { value: AUTO }, guessed),
    Object.keys(ROTATIONS).map((axis) => h("option", { value: axis }, axisName(axis))),
  );
  up.value = like?.up ?? own;
  const axisOf = (/** @type {string} */ value) => (value === AUTO ? (scene.up_axis ?? "y") : value);
  let axis = axisOf(up.value);
  up.addEventListener("change", () => {
    const before = axis;
    axis = axisOf(up.value);
    turned((view) => withAxis(view, scene.bounds, axisOf(own), before, axis));
  });
  const floor = h("input", { type: "checkbox", role: "switch" });
  const hasFloor = Boolean(scene.has_floor);
  floor.checked = like?.floor ? like.floor === "on" || (like.floor === AUTO && hasFloor) : hasFloor;
  const row = h("div", { class: "pairs stand" }, scene.up_axis ? field(t("Up axis"), up) : null, h("label", { class: "check" }, floor, t("Floor with shadows")));
  return {
    elements: [row],
    bounds: () => withAxisUp(scene.bounds, axisOf(own), axis),
    get: () => ({
      ...(scene.up_axis && up.value !== own && { up: up.value }),
      ...(floor.checked !== hasFloor && { floor: floor.checked ? "on" : "off" }),
    }),
  };
}

/** @param {string} axis */
const axisName = (axis) => axis.replace("-", "−").toUpperCase();

/**
 * Returns the view with the same direction and distance after another axis was selected as up.
 *
 * @param {View} view
 * @param {number[][] | null} bounds of the scene with `shown` up
 * @param {string} shown
 * @param {string} before the axis up in `view`
 * @param {string} after
 * @returns {View}
 */
export function withAxis(view, bounds, shown, before, after) {
  const [low, high] = bounds ?? [];
  if (!low || !high) return view;
  const centre = inFile(shown, low.map((value, k) => (value + (high[k] ?? 0)) / 2));
  const from = upright(before, centre);
  const to = upright(after, centre);
  const move = (/** @type {Vec3} */ point) => /** @type {Vec3} */ (point.map((value, k) => value + (to[k] ?? 0) - (from[k] ?? 0)));
  return { ...view, eye: move(view.eye), target: move(view.target) };
}

/**
 * Returns a scene's bounds after another axis was selected as up.
 *
 * @param {number[][] | null} bounds of the scene with `shown` up
 * @param {string} shown
 * @param {string} after
 * @returns {number[][] | null}
 */
function withAxisUp(bounds, shown, after) {
  const corners = bounds?.map((corner) => upright(after, inFile(shown, corner)));
  return corners ? [Math.min, Math.max].map((most) => [0, 1, 2].map((k) => most(...corners.map((corner) => corner[k] ?? 0)))) : null;
}

/** @param {string} axis @param {number[]} point of the file @returns {number[]} with that axis up */
const upright = (axis, point) => rowsOf(axis).map((row) => row.reduce((sum, value, k) => sum + value * (point[k] ?? 0), 0));

/** The inverse of `upright`. @param {string} axis @param {number[]} point @returns {number[]} */
const inFile = (axis, point) => [0, 1, 2].map((k) => rowsOf(axis).reduce((sum, row, r) => sum + (row[k] ?? 0) * (point[r] ?? 0), 0));

/** @param {string} axis */
const rowsOf = (axis) => /** @type {[Vec3, Vec3, Vec3]} */ (ROTATIONS[axis] ?? ROTATIONS.y);
