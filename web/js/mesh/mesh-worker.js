/**
 * Reads an upload in a web worker, so that the page stays responsive. Receives the files and the service's formats, and replies with
 * their mesh or null, and then with its textures, one by one.
 */

import { meshOf } from "./upload.js";

/** @typedef {import("./shapes.js").Picture} Picture */

const scope = /** @type {any} */ (self);

/** Side length to which larger textures are reduced. */
const WIDEST = 1024;

scope.onmessage = async (/** @type {MessageEvent<import("./upload.js").Upload>} */ { data }) => {
  const found = await meshOf(data);
  const { images, ...mesh } = found ?? { images: [] };
  scope.postMessage(found && { mesh, textures: images.length });
  for (const picture of images) {
    const image = await decoded(picture);
    scope.postMessage({ image }, image ? [image] : []);
  }
};

/** @param {Picture} picture @returns {Promise<ImageBitmap | null>} null if the browser cannot read it */
async function decoded({ bytes, type }) {
  const options = /** @type {const} */ ({ premultiplyAlpha: "none", colorSpaceConversion: "none" });
  try {
    const whole = await createImageBitmap(new Blob([bytes], { type }), options);
    const scale = WIDEST / Math.max(whole.width, whole.height);
    if (scale >= 1) return whole;
    const size = { resizeWidth: Math.max(1, Math.round(scale * whole.width)), resizeHeight: Math.max(1, Math.round(scale * whole.height)) };
    return await createImageBitmap(whole, { ...options, ...size });
  } catch {
    return null;
  }
}
