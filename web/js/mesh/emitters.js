/** Makes lamps of the shining surfaces of a file, as renderer/scene/preview_light.py does, without regard to which side shines. */

import { OMNI } from "./surface.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").Lamp} Lamp */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */

/** Part of the light that a sky of radiance 1 sends into a scene, below which its lamps are accents: then the studio lights it. */
const ACCENTS = 0.05;
/** Share of a surface's area that is seen from a direction, about. */
const SEEN = 0.25;

/**
 * Returns a mesh's shining parts as lamps; none if they are accents.
 *
 * @param {MeshPacket} packet
 * @param {Float64Array} places of its vertices
 * @returns {Lamp[]}
 */
export function emittersOf({ parts, materials, indices, low, high }, places) {
  const middle = low.map((value, i) => (value + (high[i] ?? 0)) / 2);
  let power = 0;
  const lamps = parts.flatMap(({ first, corners, material }) => {
    const { emission } = /** @type {import("../news/mesh-packet.js").MeshMaterial} */ (materials[material]);
    if (!(Math.max(...emission) > 0)) return [];
    const sum = [0, 0, 0];
    let area = 0;
    for (let i = first; i < first + corners; i += 3) {
      const [a, b, c] = [0, 1, 2].map((k) => [0, 1, 2].map((axis) => places[3 * (indices[i + k] ?? 0) + axis] ?? 0));
      if (!a || !b || !c) continue;
      const [u, v] = [b, c].map((end) => end.map((value, axis) => value - (a[axis] ?? 0)));
      const [[ux = 0, uy = 0, uz = 0] = [], [vx = 0, vy = 0, vz = 0] = []] = [u, v];
      const size = Math.hypot(uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx) / 2;
      area += size;
      for (let axis = 0; axis < 3; axis++) sum[axis] = (sum[axis] ?? 0) + (size / 3) * ((a[axis] ?? 0) + (b[axis] ?? 0) + (c[axis] ?? 0));
    }
    if (!(area > 0)) return [];
    const at = /** @type {Vec3} */ (sum.map((value) => value / area));
    const away = Math.max(Math.hypot(...at.map((value, i) => value - (middle[i] ?? 0))), Math.sqrt(area) / 2);
    const [red, green, blue] = emission;
    power += Math.PI * area * (0.2126 * red + 0.7152 * green + 0.0722 * blue);
    const color = /** @type {Vec3} */ (emission.map((value) => (value * area * SEEN) / (Math.PI * away ** 2)));
    return [{ ...OMNI, at, far: false, color }];
  });
  const radius = Math.hypot(...high.map((value, i) => value - (low[i] ?? 0))) / 2;
  return power < ACCENTS * (Math.PI * radius) ** 2 ? [] : lamps;
}
