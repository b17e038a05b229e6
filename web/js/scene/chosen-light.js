/** The environment light that a request chooses, for the preview mesh: as the service sends it (service/scenes/light.py), turned and scaled. */

import { studio, unpacked } from "./mesh-environment.js";

/** @typedef {import("./mesh-environment.js").Environment} Environment */
/** @typedef {import("../base/types.js").EnvironmentRequest} EnvironmentRequest */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/** @typedef {import("../news/mesh-packet.js").Lamp} Lamp */

/** A light as the service sends it. words: RGB9E5, in base64. lamps: with the sun. @typedef {{width: number, height: number, words: string, lamps: Lamp[]}} SentLight */
/** The light of a mesh. environment: null: black. @typedef {{environment: Environment | null, lamps: Lamp[]}} MeshLight */

/** The lights that the service has sent, by mesh and keyOf; lamps: those besides the mesh's. @type {WeakMap<MeshPacket, Map<string, MeshLight>>} */
const sent = new WeakMap();

/** Returns the source of a chosen light as JSON; "" for the scene's own light and one colour, which the page has. @param {EnvironmentRequest} chosen */
export const keyOf = ({ preset, sky, image }) => (preset || sky || image ? JSON.stringify([preset, sky, image]) : "");

/** Returns whether a mesh has a sun of its own, which goes with its environment: which of its lamps remain in another one is not known. @param {MeshPacket} mesh */
export const hasSun = (mesh) => mesh.environment !== null && mesh.lamps.some(({ far }) => far);

/** Stores a light for a mesh without a sun of its own. @param {MeshPacket} mesh @param {EnvironmentRequest} chosen @param {SentLight} light */
export function keepLight(mesh, chosen, { width, height, words, lamps }) {
  const bytes = Uint8Array.from(atob(words), (each) => each.charCodeAt(0));
  const environment = height ? unpacked({ width, height, words: new Uint32Array(bytes.buffer) }) : null;
  const known = sent.get(mesh) ?? new Map();
  known.set(keyOf(chosen), { environment, lamps: lamps.filter((lamp) => lamp.far && !isOf(mesh, lamp)) });
  sent.set(mesh, known);
}

/**
 * Returns whether the page can compute the light that a request chooses: not before the service has sent that of a preset, a sky or an
 * image, nor a colour that replaces the sky of a file with a sun.
 *
 * @param {MeshPacket} mesh
 * @param {EnvironmentRequest} chosen
 */
export function isComputable(mesh, chosen) {
  const key = keyOf(chosen);
  return key ? Boolean(sent.get(mesh)?.has(key)) : !(chosen.color && hasSun(mesh));
}

/**
 * Returns the light that a request chooses; undefined: the page cannot compute it.
 *
 * @param {MeshPacket} mesh
 * @param {EnvironmentRequest} chosen
 * @returns {MeshLight | undefined}
 */
export function chosenLight(mesh, chosen) {
  if (!isComputable(mesh, chosen)) return undefined;
  const { color, strength = 1, rotation = 0 } = chosen;
  const own = () => (mesh.environment ? unpacked(mesh.environment) : mesh.isStudio ? studio() : null);
  const found = sent.get(mesh)?.get(keyOf(chosen)) ?? { environment: color ? { width: 1, height: 1, texels: Float32Array.from(color) } : own(), lamps: [] };
  return { environment: found.environment && turned(found.environment, rotation, strength), lamps: [...mesh.lamps, ...found.lamps.map((lamp) => moved(lamp, rotation, strength))] };
}

/** Returns whether a lamp is the mesh's own, not the sun of a chosen sky. @param {MeshPacket} mesh @param {Lamp} lamp */
const isOf = (mesh, lamp) => mesh.lamps.some((each) => JSON.stringify(each) === JSON.stringify(lamp));

/** Returns an environment rotated counter-clockwise as seen from above, to the left. @param {Environment} environment @param {number} rotation degrees @param {number} strength @returns {Environment} */
function turned({ width, height, texels }, rotation, strength) {
  const turn = Math.round((rotation / 360) * width);
  const found = texels.map((_, i) => {
    const [row, column] = [Math.floor(i / 3 / width), Math.floor(i / 3) % width];
    return strength * (texels[3 * (row * width + ((((column + turn) % width) + width) % width)) + (i % 3)] ?? 0);
  });
  return { width, height, texels: found };
}

/** Returns a sun rotated and scaled likewise. @param {Lamp} lamp @param {number} rotation degrees @param {number} strength @returns {Lamp} */
function moved(lamp, rotation, strength) {
  const turn = (rotation * Math.PI) / 180;
  const [x, y, z] = lamp.at;
  const [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
  const [r, g, b] = lamp.color;
  return { ...lamp, at: [x * cosine + z * sine, y, z * cosine - x * sine], color: [strength * r, strength * g, strength * b] };
}
