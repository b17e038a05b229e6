/** The mesh of the latest upload, read in the browser: it is drawn before the service has read the file. */

/** @typedef {import("./glb-mesh.js").LocalMesh} LocalMesh */

/** Larger files are left to the service, to limit the page's memory. */
const MOST_BYTES = 512 * 1024 * 1024;

/** @type {{scene: string, mesh: Promise<LocalMesh | null>} | null} */
let latest = null;

/**
 * Starts reading an upload that is a single GLB file.
 *
 * @param {File[]} files
 * @returns {Promise<LocalMesh | null>} null for other uploads, and for files that only the service can read
 */
export function readLocally(files) {
  const [file, ...others] = files;
  if (!file || others.length || !file.name.toLowerCase().endsWith(".glb") || file.size > MOST_BYTES) return Promise.resolve(null);
  return new Promise((resolve) => {
    const worker = new Worker(new URL("./glb-worker.js", import.meta.url), { type: "module" });
    /** @type {((image: ImageBitmap | null) => void)[]} textures that are still being decoded */
    const awaited = [];
    const end = () => {
      worker.terminate();
      resolve(null); // without effect once the mesh is here
      for (const take of awaited.splice(0)) take(null);
    };
    worker.onmessage = ({ data }) => {
      if (data?.mesh) {
        /** @type {Promise<ImageBitmap | null>[]} */
        const textures = Array.from({ length: data.textures }, () => new Promise((take) => awaited.push(take)));
        resolve({ ...data.mesh, packet: { ...data.mesh.packet, textures } });
      } else if (data) awaited.shift()?.(data.image);
      if (!data || !awaited.length) end();
    };
    worker.onerror = end;
    worker.postMessage(file);
  });
}

/** Keeps the mesh of an uploaded scene. @param {string} scene its id @param {Promise<LocalMesh | null>} mesh */
export const keepLocal = (scene, mesh) => (latest = { scene, mesh });

/** Returns the mesh that was read locally for a scene. @param {string} scene its id @returns {Promise<LocalMesh | null>} */
export const localMeshOf = async (scene) => (latest?.scene === scene ? latest.mesh : null);
