/**
 * Reads an upload in a web worker, so that the page stays responsive. Receives the files and the service's formats, and replies with
 * their mesh or null, and then with its textures, one by one.
 */

import { REPEAT } from "./surface.js";
import { meshOf } from "./upload.js";

/** @typedef {import("./shapes.js").Picture} Picture */

const scope = /** @type {any} */ (self);

/** Side length to which larger textures are reduced, and the number of pixels of all of them together. */
const [WIDEST, MOST_TEXELS] = [1024, 2 ** 26];

scope.onmessage = async (/** @type {MessageEvent<import("./upload.js").Upload>} */ { data }) => {
  const found = await meshOf(data);
  const { images, ...mesh } = found ?? { images: [] };
  scope.postMessage(found && { mesh, samplers: images.map(({ sampler = REPEAT }) => sampler) });
  const widest = Math.min(WIDEST, Math.sqrt(MOST_TEXELS / images.length));
  for (const picture of images) {
    const image = await decoded(picture, widest);
    scope.postMessage({ image }, image ? [image] : []);
  }
};

/** @param {Picture} picture @param {number} widest @returns {Promise<ImageBitmap | null>} null if the browser cannot read it */
async function decoded({ bytes, type }, widest) {
  const options = /** @type {const} */ ({ premultiplyAlpha: "none", colorSpaceConversion: "none" });
  try {
    const whole = await createImageBitmap(new Blob([bytes], { type }), options);
    const scale = widest / Math.max(whole.width, whole.height);
    if (scale >= 1) return whole;
    const size = { resizeWidth: Math.max(1, Math.round(scale * whole.width)), resizeHeight: Math.max(1, Math.round(scale * whole.height)) };
    const reduced = await createImageBitmap(whole, { ...options, ...size });
    whole.close(); // a large one would stay until it is collected as garbage
    return reduced;
  } catch {
    return null;
  }
}
