/** Reads a GLB file in a web worker, so that the page stays responsive. Receives the file, and replies with its mesh or null. */

import { readGlb } from "./glb-mesh.js";

const scope = /** @type {any} */ (self);

scope.onmessage = async (/** @type {MessageEvent<File>} */ { data }) => {
  try {
    scope.postMessage(readGlb(await data.arrayBuffer()));
  } catch {
    scope.postMessage(null); // the service explains what is wrong with the file
  }
};
