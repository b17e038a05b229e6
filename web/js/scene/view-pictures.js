/** What a live view shows, as pictures in files. */

import { h } from "../base/dom.js";

/** @typedef {import("../film/film-canvas.js").FilmCanvas} FilmCanvas */

/**
 * Returns what a view shows as the URL of a picture.
 *
 * @param {FilmCanvas} picture
 * @param {HTMLCanvasElement} canvas of the picture
 * @param {number} side the longer one, in pixels, at most
 */
export function pictureUrl(picture, canvas, side) {
  picture.draw(); // WebGL keeps its picture only until the next frame
  const scale = Math.min(1, side / Math.max(canvas.width, canvas.height));
  const small = h("canvas", { width: Math.max(1, Math.round(canvas.width * scale)), height: Math.max(1, Math.round(canvas.height * scale)) });
  small.getContext("2d")?.drawImage(canvas, 0, 0, small.width, small.height);
  const url = small.toDataURL("image/webp", 0.85);
  return url.startsWith("data:image/webp") ? url : small.toDataURL("image/jpeg", 0.85); // Safari writes no WebP
}

/** Returns what a view shows as a picture in base64. @param {FilmCanvas} picture @param {HTMLCanvasElement} canvas @param {number} side */
export function pictureData(picture, canvas, side) {
  const url = pictureUrl(picture, canvas, side);
  return url.slice(url.indexOf(",") + 1);
}

/** Returns a preview mesh as the URL of a JPEG. @param {import("./mesh-canvas.js").MeshCanvas} mesh */
export function meshPicture(mesh) {
  const { width, height } = mesh.canvas;
  const whole = h("canvas", { width, height });
  const brush = whole.getContext("2d");
  if (!brush) return "";
  mesh.draw(); // WebGL keeps its picture only until the next frame
  brush.drawImage(mesh.canvas, 0, 0);
  return whole.toDataURL("image/jpeg", 0.92);
}
