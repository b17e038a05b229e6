/**
 * The status bar's pixel: its value at once from the film on the page (RGB9E5, so to 0.2 %), and when the cursor rests,
 * the exact value and sample count from the service.
 */

import { getPixel } from "./api.js";
import { h, setText } from "./dom.js";
import { radiance } from "./format.js";

/** @typedef {import("./film.js").Film} Film */

const REST_MS = 200;
const NAMES = /** @type {Record<string, string>} */ ({ normal: "XYZ", depth: "Z" });

export class PixelReadout {
  /**
   * @param {string} job
   * @param {Film} film
   */
  constructor(job, film) {
    this.job = job;
    /** "" for the colour, or an AOV. */
    this.channel = "";
    this.film = film;
    /** @type {{x: number, y: number} | null} */
    this.at = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.asking = new AbortController();
    this.place = h("span", { class: "place" });
    this.channels = [0, 1, 2].map(() => ({
      name: h("span", { class: "quiet" }),
      value: h("span", { class: "value" }),
    }));
    this.samples = h("span", { class: "samples" });
    this.hint = h("span", { class: "quiet" }, "Point at the picture to read its values");
    this.values = h(
      "span",
      { class: "values", hidden: true },
      this.place,
      this.channels.map(({ name, value }) => h("span", { class: "channel" }, name, value)),
      this.samples,
    );
    this.element = h(
      "div",
      { class: "readout number", role: "status", "aria-label": "Pixel under the cursor" },
      this.hint,
      this.values,
    );
  }

  /** @param {{x: number, y: number} | null} at */
  point(at) {
    this.at = at;
    this.refresh();
  }

  /** @param {string} channel "" for the colour, or an AOV */
  choose(channel) {
    this.channel = channel;
    this.refresh();
  }

  /** @param {{x: number, y: number, w: number, h: number}} tile of the film that has new samples */
  tileChanged({ x, y, w, h }) {
    const { at } = this;
    if (at && at.x >= x && at.y >= y && at.x < x + w && at.y < y + h) this.refresh();
  }

  /** The film changed, or the cursor moved. */
  refresh() {
    clearTimeout(this.timer);
    this.asking.abort();
    const { at } = this;
    this.hint.hidden = at !== null;
    this.values.hidden = at === null;
    if (!at) return;
    const { rgb, samples } = this.film.at(at.x, at.y);
    this.show(this.channel ? [] : rgb, samples, false);
    if (samples) this.timer = setTimeout(() => this.ask(at), REST_MS);
  }

  /** @param {{x: number, y: number}} at */
  async ask(at) {
    this.asking = new AbortController();
    try {
      const pixel = await getPixel(this.job, at.x, at.y, this.asking.signal);
      this.show([/** @type {any} */ (pixel)[this.channel || "color"]].flat(), pixel.samples, true);
    } catch {
      // Moved on, or the connection is lost (the banner says so): the page's own value stays.
    }
  }

  /**
   * @param {number[]} values
   * @param {number} samples
   * @param {boolean} exact
   */
  show(values, samples, exact) {
    const names = NAMES[this.channel] ?? "RGB";
    setText(this.place, `${this.at?.x}, ${this.at?.y}`);
    this.channels.forEach(({ name, value }, i) => {
      const number = values[i];
      setText(name, names[i] ?? "");
      setText(value, number === undefined ? "" : radiance(number));
    });
    setText(this.samples, `${samples} spp`);
    this.values.classList.toggle("exact", exact);
    this.values.title = exact
      ? "Exact values of the film, linear Rec.709"
      : "Values of the live picture, true to 0.2 %";
  }

  dispose() {
    clearTimeout(this.timer);
    this.asking.abort();
  }
}
