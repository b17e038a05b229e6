/** The lamps by which a preview mesh is shaded: the strongest ones, and what all others and reflections between surfaces add. */

import { rectangleOf } from "./mesh-parts.js";
import { MOST_GLOWS, MOST_LAMPS } from "./mesh-light-shader.js";
import { boxOf } from "./mesh-shadow-places.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").Lamp} Lamp */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/** A lamp that is a rectangle: the part that shines, from its middle to those of two sides, and its radiance. @typedef {{part: import("../news/mesh-packet.js").MeshPart, halves: [Vec3, Vec3], radiance: Vec3}} Rectangle */

/** Radiance of a white surface that all lamps together light, where a file states no unit, or they are far too weak or strong. */
const USUAL = 1.5;
const [WEAKEST, STRONGEST] = [0.05, 20];
/** Part of their light that other surfaces reflect, about, and that all others than the strongest give from all around. */
const [BETWEEN, SCATTERED] = [0.15, 0.5];

/**
 * @param {Lamp[]} lamps
 * @param {boolean} isAlone whether nothing else lights the scene
 * @param {MeshPacket} mesh
 * @returns {{lamps: Lamp[], around: Vec3}} lamps: at most MOST_LAMPS that cast shadows, then at most MOST_GLOWS weaker ones inside emissive parts. around: radiance from all directions
 */
export function lampsOf(lamps, isAlone, mesh) {
  const bright = (/** @type {Lamp} */ { color }) => Math.max(...color);
  const total = lamps.reduce((sum, lamp) => sum + bright(lamp), 0);
  const isOutside = isAlone && (total < WEAKEST || total > STRONGEST);
  const scale = total && (isOutside || lamps.some(({ isRelative }) => isRelative)) ? USUAL / total : 1;
  const sorted = lamps.toSorted((a, b) => bright(b) - bright(a)).map((lamp) => ({ ...lamp, color: scaled(lamp.color, scale) }));
  const sum = (/** @type {Lamp[]} */ of) => of.reduce((all, { color }) => /** @type {Vec3} */ (all.map((value, i) => value + (color[i] ?? 0))), /** @type {Vec3} */ ([0, 0, 0]));
  const weak = sorted.slice(MOST_LAMPS);
  const glows = glowing(mesh, weak).slice(0, MOST_GLOWS); // as ambient light, they would not light what is next to them
  const [between, others] = [scaled(sum(sorted), isAlone ? BETWEEN * Math.min(1, USUAL / (total * scale || 1)) : 0), scaled(sum(weak.filter((lamp) => !glows.includes(lamp))), SCATTERED)];
  return { lamps: [...sorted.slice(0, MOST_LAMPS), ...glows], around: /** @type {Vec3} */ (between.map((value, i) => value + (others[i] ?? 0))) };
}

/** Returns the lamps that lie inside the bounds of an emissive part. @param {MeshPacket} mesh @param {Lamp[]} lamps */
function glowing(mesh, lamps) {
  if (!lamps.length) return [];
  const boxes = mesh.parts.filter(({ material }) => Math.max(...(mesh.materials[material]?.emission ?? [])) > 0).map((part) => boxOf(mesh, part));
  const center = mesh.low.map((value, i) => (value + (mesh.high[i] ?? 0)) / 2);
  const isIn = (/** @type {Lamp} */ { at }, /** @type {ReturnType<typeof boxOf>} */ { low, high }) => at.every((value, i) => value - (center[i] ?? 0) >= (low[i] ?? 0) && value - (center[i] ?? 0) <= (high[i] ?? 0));
  return lamps.filter((lamp) => !lamp.far && boxes.some((box) => isIn(lamp, box)));
}

/** Distance of a lamp from the middle of a rectangle that it stands for, in proportion to its sides. */
const APART = 0.05;

/** Returns the rectangles that lamps stand for; null where one is something else. @param {MeshPacket} mesh @param {Lamp[]} lamps @returns {(Rectangle | null)[]} */
export function rectanglesOf(mesh, lamps) {
  if (!lamps.length) return [];
  const shining = mesh.parts.flatMap((part) => {
    const { emission: radiance, emission_texture: texture } = /** @type {import("../news/mesh-packet.js").MeshMaterial} */ (mesh.materials[part.material]);
    const found = Math.max(...radiance) > 0 && texture < 0 ? rectangleOf(mesh, part) : null;
    return found ? [{ ...found, part, radiance }] : [];
  });
  const center = mesh.low.map((value, i) => (value + (mesh.high[i] ?? 0)) / 2);
  return lamps.map(({ at, far }) => shining.find(({ middle, halves }) => !far && Math.hypot(...middle.map((value, i) => value + (center[i] ?? 0) - (at[i] ?? 0))) < APART * Math.hypot(...halves.flat())) ?? null);
}

/** Returns the radiance of a white surface in the light of the lamps that are far away. @param {Vec3} normal @param {Lamp[]} lamps @returns {Vec3} */
export const sunsOn = (normal, lamps) =>
  lamps.filter(({ far }) => far).reduce((all, { at, color }) => {
    const facing = Math.max(0, at.reduce((sum, value, i) => sum + value * (normal[i] ?? 0), 0)) / (Math.hypot(...at) || 1);
    return /** @type {Vec3} */ (all.map((value, i) => value + facing * (color[i] ?? 0)));
  }, /** @type {Vec3} */ ([0, 0, 0]));

/** @param {Vec3} color @param {number} factor @returns {Vec3} */
const scaled = (color, factor) => /** @type {Vec3} */ (color.map((value) => value * factor));
