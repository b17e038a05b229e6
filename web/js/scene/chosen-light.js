/** The environment light that a request chooses, for the preview mesh. Sources of the presets: renderer/scene/presets.py. */

import { HEIGHT, directionsOf, studio, unpacked } from "./mesh-environment.js";

/** @typedef {import("./mesh-environment.js").Environment} Environment */
/** @typedef {import("../base/types.js").EnvironmentRequest} EnvironmentRequest */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */

/** Softboxes: azimuth and elevation, half of width and height, all in degrees, and radiance. @type {Record<string, [number, number, number, number, number][]>} */
const LAMPS = {
  studio: [
    [-48, 36, 22, 17, 7],
    [62, 22, 15, 26, 2.4],
    [5, 80, 34, 15, 1.2],
    [155, 34, 14, 12, 3.5],
  ],
  "dark-studio": [
    [-62, 12, 6, 46, 12],
    [58, 12, 6, 46, 7],
    [180, 58, 40, 5, 6],
  ],
};

/** Radiance by the sine of the elevation. @type {Record<string, (up: number) => number>} */
const BEHIND = {
  studio: (up) => 0.16 + 0.44 * (up > 0 ? Math.exp(-((up / 0.4) ** 2)) : Math.exp(3.2 * up)),
  "dark-studio": (up) => 0.02 + 0.05 * Math.exp(-((up / 0.25) ** 2)),
  "even-white": () => 1,
  overcast: (up) => (up > 0 ? (9 / 7) * ((1 + 2 * up) / 3) : 0.2),
};

/** @param {number} place */
function softEdge(place) {
  const at = Math.min(Math.max((1 - Math.abs(place)) / 0.1, 0), 1);
  return at * at * (3 - 2 * at);
}

/** Returns the radiance of a preset; null for skies and unknown presets. @param {string} name @returns {Environment | null} */
export function presetLight(name) {
  const behind = BEHIND[name];
  if (!behind) return null;
  const radians = (/** @type {number} */ degrees) => (degrees * Math.PI) / 180;
  const lamps = (LAMPS[name] ?? []).map(([around, above, wide, high, radiance]) => {
    const [a, e] = [radians(around), radians(above)];
    return {
      right: [Math.cos(a), 0, -Math.sin(a)],
      over: [-Math.sin(e) * Math.sin(a), Math.cos(e), -Math.sin(e) * Math.cos(a)],
      towards: [Math.cos(e) * Math.sin(a), Math.sin(e), Math.cos(e) * Math.cos(a)],
      ...{ wide: Math.tan(radians(wide)), high: Math.tan(radians(high)), radiance },
    };
  });
  const ways = directionsOf(HEIGHT);
  const texels = new Float32Array(6 * HEIGHT * HEIGHT);
  for (let i = 0; i < 2 * HEIGHT * HEIGHT; i++) {
    const way = [ways[4 * i] ?? 0, ways[4 * i + 1] ?? 0, ways[4 * i + 2] ?? 0];
    const along = (/** @type {number[]} */ axis) => axis.reduce((sum, value, k) => sum + value * (way[k] ?? 0), 0);
    let value = behind(way[1] ?? 0);
    for (const { right, over, towards, wide, high, radiance } of lamps) {
      const depth = along(towards);
      if (depth <= 0) continue;
      const [u, v] = [along(right) / depth / wide, along(over) / depth / high];
      const box = softEdge(u) * softEdge(v) * (1 - 0.35 * Math.min(u * u + v * v, 1));
      value = value * (1 - box) + radiance * box;
    }
    texels.fill(value, 3 * i, 3 * i + 3);
  }
  return { width: 2 * HEIGHT, height: HEIGHT, texels };
}

/**
 * Returns whether the page can compute the light that a request chooses: not that of skies, images and unknown presets, nor one that
 * replaces the sky of a file with a sun.
 *
 * @param {MeshPacket} mesh
 * @param {EnvironmentRequest} chosen
 */
export function isComputable(mesh, { color, preset, sky, image }) {
  const hasSun = mesh.environment !== null && mesh.lamps.some(({ far }) => far);
  return !(sky || image || ((color || preset) && hasSun)) && Boolean(color || !preset || BEHIND[preset]);
}

/**
 * Returns the environment light that a request chooses. undefined: the page cannot compute it; null: black.
 *
 * @param {MeshPacket} mesh
 * @param {EnvironmentRequest} chosen
 * @returns {Environment | null | undefined}
 */
export function chosenLight(mesh, chosen) {
  if (!isComputable(mesh, chosen)) return undefined;
  const { color, preset, strength = 1, rotation = 0 } = chosen;
  const own = () => (mesh.environment ? unpacked(mesh.environment) : mesh.isStudio ? studio() : null);
  const light = color ? { width: 1, height: 1, texels: Float32Array.from(color) } : preset ? presetLight(preset) : own();
  if (!light) return null;
  const { width, height, texels } = light;
  const turn = Math.round((rotation / 360) * width); // counter-clockwise seen from above: to the left
  const turned = texels.map((_, i) => {
    const [row, column] = [Math.floor(i / 3 / width), Math.floor(i / 3) % width];
    return strength * (texels[3 * (row * width + ((((column + turn) % width) + width) % width)) + (i % 3)] ?? 0);
  });
  return { width, height, texels: turned };
}
