/** The mesh of the latest upload, read in the browser: it is drawn before the service has read the file. */

import { getInfo } from "./api.js";

/** @typedef {import("../mesh/shapes.js").LocalMesh} LocalMesh */
/** @typedef {import("../shell/gather-files.js").NamedFile} NamedFile */

/** Larger uploads are left to the service, to limit the page's memory. */
const MOST_BYTES = 512 * 1024 * 1024;
/** Uploads that take longer to read, in milliseconds, are left to the service: also a small file may be made to take very long. */
const MOST_MS = 30_000;
/** Files that the page reads itself, or may find in an archive. */
const READ_HERE = /\.(fbx|glb|gltf|obj|ply|stl|vrm|zip)$/i;

/** @type {{scene: string, mesh: Promise<LocalMesh | null>} | null} */
let latest = null;

/** A worker for the next upload, which loads its modules meanwhile. @type {Worker | null} */
let spare = null;

/** Prepares for an upload that is likely: files are dragged over the page or chosen. */
export function prepareReader() {
  if (spare) return;
  spare = new Worker(new URL("../mesh/mesh-worker.js", import.meta.url), { type: "module" });
  spare.onerror = () => (spare = null); // it could not be loaded
}

/**
 * Starts reading an upload.
 *
 * @param {NamedFile[]} files
 * @param {AbortSignal} refused ends it
 * @param {string} [main] the scene's file, if it is known
 * @returns {Promise<LocalMesh | null>} null for uploads that only the service can read
 */
export async function readLocally(files, refused, main) {
  if (!files.some(({ path }) => READ_HERE.test(path)) || files.reduce((sum, { file }) => sum + file.size, 0) > MOST_BYTES) return null;
  prepareReader();
  const { formats } = await getInfo();
  if (refused.aborted) return null;
  prepareReader(); // another upload may have taken it
  const worker = /** @type {Worker} */ (spare);
  spare = null;
  return new Promise((resolve) => {
    /** @type {((image: ImageBitmap | null) => void)[]} textures that are still being decoded */
    const awaited = [];
    const end = () => {
      clearTimeout(late);
      worker.terminate();
      resolve(null); // without effect once the mesh is here
      for (const take of awaited.splice(0)) take(null);
    };
    worker.onmessage = ({ data }) => {
      if (data?.mesh) {
        /** @type {import("./mesh-packet.js").MeshTexture[]} */
        const textures = data.samplers.map((/** @type {import("./mesh-packet.js").Sampler} */ sampler) => ({ sampler, image: new Promise((take) => awaited.push(take)) }));
        resolve({ ...data.mesh, packet: { ...data.mesh.packet, textures } });
      } else if (data) awaited.shift()?.(data.image);
      if (!data || !awaited.length) end();
    };
    worker.onerror = end;
    refused.addEventListener("abort", end);
    const late = setTimeout(end, MOST_MS);
    worker.postMessage({ files, formats, main });
  });
}

/** Keeps the mesh of an uploaded scene. @param {string} scene its id @param {Promise<LocalMesh | null>} mesh */
export const keepLocal = (scene, mesh) => (latest = { scene, mesh });

/** Returns the mesh that was read locally for a scene. @param {string} scene its id @returns {Promise<LocalMesh | null>} */
export const localMeshOf = async (scene) => (latest?.scene === scene ? latest.mesh : null);
