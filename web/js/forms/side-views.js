/** The sides from which a scene is seen: each frames the scene's bounds as the automatic camera frames its points. */

import { frame } from "../mesh/shapes.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */

/** Elevation from which a scene is seen from above, in radians: straight down, the camera could not be turned about the vertical. */
const ABOVE = (89 * Math.PI) / 180;

/**
 * Directions to the camera, as parts of the scene's front, right and up. short: the label of a small button, which css/view-tools.css capitalises. key: as on Blender's number
 * pad, with Shift for its Ctrl.
 *
 * @type {Record<string, {label: string, short: string, key: string, towards: Vec3}>}
 */
export const SIDES = {
  front: { label: t("From the front"), short: t("front"), key: "1", towards: [1, 0, 0] },
  back: { label: t("From the back"), short: t("back"), key: "Shift+1", towards: [-1, 0, 0] },
  left: { label: t("From the left"), short: t("left"), key: "Shift+3", towards: [0, -1, 0] },
  right: { label: t("From the right"), short: t("right"), key: "3", towards: [0, 1, 0] },
  top: { label: t("From above"), short: t("top"), key: "7", towards: [Math.cos(ABOVE), 0, Math.sin(ABOVE)] },
};

/**
 * @param {string} side one of SIDES
 * @param {number[][]} bounds lower and upper corner of the scene
 * @param {Vec3} up of the automatic camera, a unit vector: the front is +Z for Y up and -Y for Z up, as renderer/scene/default_camera.py has it
 * @returns {View | null} null if there is no such side
 */
export function sideView(side, bounds, up) {
  const chosen = SIDES[side];
  const [low = [], high = []] = bounds;
  if (!chosen) return null;
  const front = Math.abs(up[2]) < 0.9 ? [0, 0, 1] : [0, -1, 0];
  const right = [0, 1, 2].map((i) => (up[(i + 1) % 3] ?? 0) * (front[(i + 2) % 3] ?? 0) - (up[(i + 2) % 3] ?? 0) * (front[(i + 1) % 3] ?? 0));
  const [ahead, aside, above] = chosen.towards;
  const towards = /** @type {Vec3} */ ([0, 1, 2].map((i) => ahead * (front[i] ?? 0) + aside * (right[i] ?? 0) + above * (up[i] ?? 0)));
  const corners = Array.from({ length: 8 }, (_, corner) => [0, 1, 2].map((i) => ((corner >> i) & 1 ? high[i] : low[i]) ?? 0));
  return frame(Float64Array.from(corners.flat()), towards, up);
}
