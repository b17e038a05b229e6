/**
 * A placeholder for a film that is being loaded: the small picture that a list of jobs has shown, or a word; over it one of about the
 * stage's size; and over that the denoised one in full resolution, as soon as they have come. It is under the canvas, and is removed
 * once the canvas has something to draw.
 */

import { h } from "../base/dom.js";
import { showImage } from "../news/images.js";
import { takePrepared } from "./first-look.js";
import { t } from "../base/words.js";

/** @typedef {import("./viewport.js").Viewport} Viewport */

export class Poster {
  /** @param {string | null} url null: the place stays black @param {string} [sharp] URL of a denoised picture in full resolution; "": none @param {string} [nearest] URL of a smaller one that the browser has; "": none */
  constructor(url, sharp = "", nearest = "") {
    this.element = h("div", { class: "poster", "aria-hidden": "true" });
    /** Resolves when the image is shown, or cannot be. @type {Promise<void>} */
    this.loaded = Promise.resolve();
    if (!url) return;
    const known = takePrepared(url);
    if (known) {
      this.element.append(known);
      return;
    }
    const image = h("img", { alt: "", decoding: "sync", fetchpriority: "high" });
    const word = h("p", { class: "small quiet" }, nearest ? "" : t("Loading the picture …"));
    this.element.classList.add("loading");
    this.element.append(image, word);
    const place = this.element.style;
    if (nearest) place.backgroundImage = `url("${nearest}")`;
    const fillEdges = () => (place.backgroundImage = `url("${url}")`); // under the image, whose edges are transparent where it is blurred
    const hasAlpha = url.includes("/image.png"); // as thumbnailFormat requests a transparent background
    this.element.classList.toggle("has-alpha", hasAlpha);
    if (!hasAlpha) image.addEventListener("load", fillEdges, { once: true });
    if (sharp) this.sharpen(sharp);
    const loaded = () => (word.remove(), this.element.classList.remove("loading"));
    this.loaded = showImage(image, url).then(loaded, () => (loaded(), image.remove())); // a picture without samples; the stage shows the reason
  }

  /** Shows the picture in full resolution once it is here. @param {string} url */
  sharpen(url) {
    const image = h("img", { class: "sharp", alt: "", hidden: true });
    this.element.append(image);
    const shown = () => image.decode().then(() => (image.hidden = false));
    showImage(image, url).then(shown).catch(() => image.remove()); // the small one stays
  }

  /** @param {Viewport} viewport @param {HTMLCanvasElement} canvas in front of the poster */
  place(viewport, canvas) {
    placeOver(this.element, viewport, canvas);
  }
}

/** Lays an element where a viewport has the picture. @param {HTMLElement} element @param {Viewport} viewport @param {HTMLCanvasElement} canvas of the picture */
export function placeOver({ style }, { x, y, scale, picture }, canvas) {
  const ratio = devicePixelRatio;
  style.left = `${parseFloat(canvas.style.left || "0") + x / ratio}px`;
  style.top = `${parseFloat(canvas.style.top || "0") + y / ratio}px`;
  style.width = `${(picture.width * scale) / ratio}px`;
  style.height = `${(picture.height * scale) / ratio}px`;
}
