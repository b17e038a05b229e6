/** Navigation of a view: orbit around its target, pan, dolly. Pure arithmetic on views. */

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */

/** Maximum elevation angle, since the view is undefined along `up`. */
const STEEPEST = (89 * Math.PI) / 180;

/** Up in the world: readers turn files with other axes. @type {Vec3} */
const WORLD_UP = [0, 1, 0];
/** Sine of the roll below which a camera counts as upright: files store axes as float32. */
const LEVEL = 1e-3;

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const add = (a, b) => [a[0] + b[0], a[1] + b[1], a[2] + b[2]];
/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const subtract = (a, b) => [a[0] - b[0], a[1] - b[1], a[2] - b[2]];
/** @param {Vec3} a @param {number} s @returns {Vec3} */
const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s];
/** @param {Vec3} a @param {Vec3} b */
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {Vec3} a */
const length = (a) => Math.hypot(...a);
/** @param {Vec3} a @returns {Vec3} */
const unit = (a) => scale(a, 1 / length(a));

/** Distance from the eye to the target. @param {View} view */
const distanceOf = ({ eye, target }) => length(subtract(target, eye));

/** Height of the visible area at the target's distance, in scene units. @param {View} view */
function heightAtTarget(view) {
  if (view.projection === "orthographic") return view.height ?? 2;
  return 2 * distanceOf(view) * Math.tan(((view.projection === "panorama" ? 90 : view.fov) * Math.PI) / 360);
}

/** The camera's axes: right, up in the picture, and forward. @param {View} view */
function axes({ eye, target, up }) {
  const forward = unit(subtract(target, eye));
  const right = unit(cross(forward, up));
  return { right, above: cross(right, forward), forward };
}

/**
 * The same view with the world's up, if its camera has no roll. A file's camera comes with its own Y axis, which tilts with the
 * camera's pitch: turning about that tilts the horizon.
 *
 * @param {View} view
 * @returns {View}
 */
function upright(view) {
  const { right, above } = axes(view);
  return Math.abs(right[1]) < LEVEL && above[1] > LEVEL ? { ...view, up: WORLD_UP } : view;
}

/**
 * Rotates a direction about `up` to the left and raises it, up to the maximum elevation.
 *
 * @param {Vec3} direction
 * @param {Vec3} up
 * @param {number} left radians
 * @param {number} raise radians
 * @returns {Vec3} of the same length
 */
function turned(direction, up, left, raise) {
  const axis = unit(up);
  const size = length(direction);
  const elevation = Math.asin(Math.min(Math.max(dot(direction, axis) / size, -1), 1));
  const level = unit(subtract(direction, scale(axis, dot(direction, axis))));
  const side = cross(axis, level);
  const heading = add(scale(level, Math.cos(left)), scale(side, Math.sin(left)));
  const next = Math.min(Math.max(elevation + raise, -STEEPEST), STEEPEST);
  return add(scale(heading, size * Math.cos(next)), scale(axis, size * Math.sin(next)));
}

/**
 * Rotates the eye around the target, as if turning the scene by hand; a panorama rotates around its eye instead.
 *
 * @param {View} view
 * @param {number} dx radians by which the scene turns to the right
 * @param {number} dy radians by which it turns down
 * @returns {View}
 */
export function orbit(view, dx, dy) {
  const level = upright(view);
  const { eye, target, up } = level;
  if (view.projection === "panorama") return { ...level, target: add(eye, turned(subtract(target, eye), up, dx, dy)) };
  return { ...level, eye: add(target, turned(subtract(eye, target), up, -dx, dy)) };
}

/**
 * Moves eye and target parallel to the picture, so that points at the target's distance follow the pointer.
 *
 * @param {View} view
 * @param {number} dx to the right, in picture heights
 * @param {number} dy down, in picture heights
 * @returns {View}
 */
export function pan(view, dx, dy) {
  const { right, above } = axes(view);
  const size = heightAtTarget(view);
  const move = add(scale(right, -dx * size), scale(above, dy * size));
  return { ...view, eye: add(view.eye, move), target: add(view.target, move) };
}

/**
 * Moves the eye towards the target (factor below 1) or away from it; an orthographic view changes its height instead.
 *
 * @param {View} view
 * @param {number} factor
 * @returns {View}
 */
export function dolly(view, factor) {
  const eye = add(view.target, scale(subtract(view.eye, view.target), factor));
  return view.projection === "orthographic"
    ? { ...view, eye, height: heightAtTarget(view) * factor }
    : { ...view, eye };
}

/**
 * Returns the focus distance along the line of sight at which the point seen by a pixel of a perspective picture is sharp.
 *
 * @param {View} view
 * @param {{width: number, height: number}} size of the picture
 * @param {{x: number, y: number}} at a pixel
 * @param {number} depth from the eye
 */
export function alongSight({ fov, shift_x: right = 0, shift_y: up = 0 }, { width, height }, at, depth) {
  const half = Math.tan((fov * Math.PI) / 360);
  const x = ((2 * (at.x + 0.5) - width) / height + 2 * right) * half;
  const y = ((2 * (at.y + 0.5) - height) / height - 2 * up) * half;
  return depth / Math.hypot(x, y, 1);
}

/**
 * Moves eye and target together, as when walking or flying.
 *
 * @param {View} view
 * @param {number} right in scene units, as the others
 * @param {number} up along the camera's `up`
 * @param {number} ahead along the line of sight
 * @returns {View}
 */
export function fly(view, right, up, ahead) {
  const { right: side, forward } = axes(view);
  const move = add(add(scale(side, right), scale(unit(upright(view).up), up)), scale(forward, ahead));
  return { ...view, eye: add(view.eye, move), target: add(view.target, move) };
}

/**
 * Sets the target without moving the eye; orbiting then rotates around it.
 * @param {View} view
 * @param {Vec3} place
 * @returns {View}
 */
export function lookAt(view, place) {
  if (distanceOf({ ...view, target: place }) < 1e-6 * distanceOf(view)) return view;
  const next = { ...view, target: place };
  const along = dot(unit(subtract(place, view.eye)), unit(view.up));
  return Math.abs(along) > Math.sin(STEEPEST) ? view : next;
}

/**
 * Floor below a scene: its height along `up`, and the height above it down to which the eye may go.
 * @typedef {{up: Vec3, height: number, clearance: number}} Floor
 */

/**
 * Returns the floor below a scene, or null if it has none of the studio's.
 * @param {boolean} hasFloor
 * @param {Vec3} up axis of the scene
 * @param {ArrayLike<number>} low lower corner of the scene
 * @param {number} size of the scene: its diagonal
 * @returns {Floor | null}
 */
export function floorBelow(hasFloor, up, low, size) {
  return hasFloor ? { up, height: up.reduce((sum, value, i) => sum + value * (low[i] ?? 0), 0), clearance: CLEARANCE * size } : null;
}

/** Least height of the eye above the floor, in diagonals of the scene. */
const CLEARANCE = 0.01;

/**
 * Returns a view whose eye does not go through the floor, which would hide the scene: an eye that turns around its target slides
 * along the floor, and one that moves with its target, or comes near a target at the floor, stays above it. A camera that was
 * below already is free.
 *
 * @param {View} before
 * @param {View} next
 * @param {Floor | null} floor
 * @returns {View}
 */
export function aboveFloor(before, next, floor) {
  if (!floor) return next;
  const { up, height, clearance } = floor;
  const was = dot(before.eye, up);
  const lowest = Math.min(height + clearance, was);
  const missing = lowest - dot(next.eye, up);
  if (was <= height || missing <= 0) return next;
  const away = subtract(next.eye, next.target);
  const rise = lowest - dot(next.target, up);
  const isSteep = Math.abs(rise) > Math.sin(STEEPEST) * length(away); // the target is too near for the eye to slide around it
  if (isSteep || next.target.some((value, i) => value !== before.target[i])) {
    const lift = scale(up, missing);
    return { ...next, eye: add(next.eye, lift), target: add(next.target, lift) };
  }
  const level = subtract(away, scale(up, dot(away, up)));
  const across = Math.sqrt(Math.max(dot(away, away) - rise * rise, 0));
  return { ...next, eye: add(next.target, add(scale(unit(level), across), scale(up, rise))) };
}

/** Largest difference between the numbers of equal views, relative to the distance of the target. */
const SAME = 1e-4;

/** @param {View} a @param {View} b @returns {boolean} whether both show the same part of the scene */
export function isSameView(a, b) {
  if ((a.projection ?? "perspective") !== (b.projection ?? "perspective")) return false;
  const numbers = (/** @type {View} */ view) => [...view.eye, ...view.target, ...view.up, heightAtTarget(view), view.shift_x ?? 0, view.shift_y ?? 0];
  const [p, q, size] = [numbers(a), numbers(b), distanceOf(a)];
  return p.every((value, i) => Math.abs(value - (q[i] ?? 0)) <= SAME * size);
}
