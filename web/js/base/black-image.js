/** Marks small pictures that are black, which would look like pictures that are still missing. */

import { h } from "./dom.js";
import { t } from "./words.js";

/** Longer side, in pixels, at which pictures are looked at. */
const SIDE = 128;

/** Whether every pixel of a loaded picture is black, or transparent. @param {HTMLImageElement} image */
export function isBlack(image) {
  const { naturalWidth: width, naturalHeight: height } = image;
  if (!width || !height) return false;
  const scale = Math.min(1, SIDE / Math.max(width, height));
  const canvas = h("canvas", { width: Math.max(1, Math.round(scale * width)), height: Math.max(1, Math.round(scale * height)) });
  const brush = canvas.getContext("2d", { willReadFrequently: true });
  if (!brush) return false;
  brush.drawImage(image, 0, 0, canvas.width, canvas.height);
  const { data } = brush.getImageData(0, 0, canvas.width, canvas.height);
  return data.every((value, i) => i % 4 === 3 || value === 0);
}

/** Puts a word over a picture that shows nothing, or removes it. @param {HTMLElement} box @param {HTMLImageElement} image loaded, in the box @param {string} [reason] why nothing can be seen, if that is known */
export function markBlack(box, image, reason = "") {
  box.querySelector(".nothing")?.remove();
  if (reason || isBlack(image)) box.append(h("span", { class: "nothing small", title: reason }, t("Nothing visible")));
}
