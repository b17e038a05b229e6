/**
 * A view as a few characters of the URL: eye, target and field of view, and other values that differ from the defaults.
 *
 *     view=3_2_5*0_1_0*40*u0_0_1*a0.02*d5.3*port*h2     u: up, a: aperture, d: focus, p: projection, h: height, n: near,
 *     x, y: shift of the lens
 */

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */

const PROJECTIONS = { ort: "orthographic", pan: "panorama" };

/** Six digits place a camera to a pixel. @param {number} value */
const short = (value) => String(Number(value.toPrecision(6)));
/** @param {Vec3} vector */
const join = (vector) => vector.map(short).join("_");

/** @param {View} view */
export function viewToText(view) {
  const parts = [join(view.eye), join(view.target), short(view.fov)];
  if (join(view.up) !== "0_1_0") parts.push(`u${join(view.up)}`);
  if (view.aperture) parts.push(`a${short(view.aperture)}`);
  if (view.focus != null) parts.push(`d${short(view.focus)}`);
  if (view.near) parts.push(`n${short(view.near)}`);
  if (view.shift_x) parts.push(`x${short(view.shift_x)}`);
  if (view.shift_y) parts.push(`y${short(view.shift_y)}`);
  const projection = Object.entries(PROJECTIONS).find(([, name]) => name === view.projection)?.[0];
  if (projection) parts.push(`p${projection}`);
  if (view.projection === "orthographic" && view.height != null) parts.push(`h${short(view.height)}`);
  return parts.join("*");
}

/** @param {string | null} text @returns {View | null} null where it is none */
export function viewFromText(text) {
  const [eye, target, fov, ...rest] = (text ?? "").split("*");
  /** @type {View} */
  const view = { eye: vector(eye), target: vector(target), up: [0, 1, 0], fov: Number(fov), projection: "perspective" };
  for (const part of rest) {
    const value = part.slice(1);
    if (part[0] === "u") view.up = vector(value);
    if (part[0] === "a") view.aperture = Number(value);
    if (part[0] === "d") view.focus = Number(value);
    if (part[0] === "n") view.near = Number(value);
    if (part[0] === "x") view.shift_x = Number(value);
    if (part[0] === "y") view.shift_y = Number(value);
    if (part[0] === "h") view.height = Number(value);
    if (part[0] === "p") view.projection = /** @type {Record<string, string>} */ (PROJECTIONS)[value] ?? "perspective";
  }
  const lens = [view.fov, view.aperture, view.focus, view.near, view.height, view.shift_x, view.shift_y];
  const numbers = [...view.eye, ...view.target, ...view.up, ...lens];
  const isOne = numbers.every((value) => value == null || Number.isFinite(value)) && view.fov > 0 && view.fov < 180;
  const isSomewhere = view.eye.some((value, i) => value !== view.target[i]) && view.up.some(Boolean);
  return isOne && isSomewhere ? view : null;
}

/** @param {string | undefined} text @returns {Vec3} NaN where it is none */
function vector(text) {
  const found = (text ?? "").split("_").map((each) => (each === "" ? NaN : Number(each)));
  return found.length === 3 ? /** @type {Vec3} */ (found) : [NaN, NaN, NaN];
}
