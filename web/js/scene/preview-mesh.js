/** The preview mesh of the latest scene, and the view that it was turned to while the scene was being prepared. */

import { fetchMesh } from "../news/api.js";
import { localMeshOf } from "../news/local-mesh.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */

/** abandon: ends its download. @type {{scene: string, mesh: Promise<MeshPacket>, abandon: AbortController} | null} */
let latest = null;

/** How long the service's mesh waits for what this page reads, in milliseconds. */
const WAITED_MS = 3000;

/** Returns a scene's mesh: the one that this page read if it is complete, otherwise the service's, which is fetched once. @param {string} scene its id @returns {Promise<MeshPacket>} */
export function meshOf(scene) {
  if (latest?.scene !== scene) {
    latest?.abandon.abort(); // it may have tens of megabytes to go
    const abandon = new AbortController();
    const mesh = Promise.race([localMeshOf(scene), late()]).then((local) => (local?.isWhole ? local.packet : fetchMesh(scene, abandon.signal)));
    const asked = { scene, mesh, abandon };
    asked.mesh.catch(() => latest === asked && (latest = null)); // it may fail while another scene is open
    latest = asked;
  }
  return latest.mesh;
}

/** @returns {Promise<null>} */
const late = () => new Promise((resolve) => setTimeout(resolve, WAITED_MS, null));

/** The view to which the mesh was rotated, with its scene. @type {{scene: string, view: View} | null} */
let turned = null;

/** @param {string} scene @param {View} view */
export const keepTurned = (scene, view) => (turned = { scene, view });

/** Returns and removes the view to which a scene's mesh was rotated. @param {string} scene @returns {View | null} */
export function takeTurned(scene) {
  const view = turned?.scene === scene ? turned.view : null;
  if (view) turned = null;
  return view;
}
