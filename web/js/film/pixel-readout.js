/**
 * The pixel in the status bar: its value at once from the page's film (RGB9E5, accurate to 0.2 %), and when the cursor rests,
 * the exact value and sample count from the service.
 */

import { getPixel } from "../news/api.js";
import { DENOISED, DENOISED_MIX, MIX, channelOf, lightGroupOf } from "./channels.js";
import { h, setText } from "../base/dom.js";
import { LiveFilm } from "./live-film.js";
import { mixPixel } from "./light-mix.js";
import { count, radiance } from "../base/format.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("./picture-side.js").PictureSide} PictureSide */

const REST_MS = 200;
const MOST_VALUES = 3;

export class PixelReadout {
  /** @param {PictureSide} side whose pixels are read */
  constructor(side) {
    this.side = side;
    /** @type {{x: number, y: number} | null} */
    this.at = null;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.timer = undefined;
    this.asking = new AbortController();
    this.place = h("span", { class: "place" });
    this.values = Array.from({ length: MOST_VALUES }, () => ({
      name: h("span", { class: "quiet" }),
      value: h("span", { class: "value" }),
    }));
    this.samples = h("span", { class: "samples" });
    this.hint = h("span", { class: "quiet hint" }, matchMedia("(pointer: coarse)").matches ? t("Tap the picture to read its values") : t("Point at the picture to read its values"));
    this.name = h("strong", null);
    this.line = h(
      "span",
      { class: "values", hidden: true },
      this.name,
      this.place,
      this.values.map(({ name, value }) => h("span", { class: "channel" }, name, value)),
      this.samples,
    );
    this.element = h(
      "div",
      { class: "readout number", role: "status", "aria-live": "off", "aria-label": t("Pixel under the cursor") },
      this.hint,
      this.line,
    );
    const unlisten = [
      side.state.subscribe(() => this.refresh()),
      side.live.onTurn(() => this.refresh()),
      side.live.onTile(({ x, y, w, h }) => {
        const { at } = this;
        if (at && at.x >= x && at.y >= y && at.x < x + w && at.y < y + h) this.refresh();
      }),
    ];
    this.dispose = () => {
      clearTimeout(this.timer);
      this.asking.abort();
      for (const end of unlisten) end();
      this.element.remove();
    };
  }

  /** @param {string} name of the side where there are two; "" where it is alone */
  setName(name) {
    setText(this.name, name);
    this.element.setAttribute("aria-label", t("Pixel under the cursor") + (name && `, ${name}`));
  }

  /** @param {{x: number, y: number} | null} at @param {boolean} aloud whether to announce the values, since the cursor was moved by keys */
  point(at, aloud) {
    this.at = at;
    this.refresh(aloud);
  }

  /**
   * Updates after a change of the film, the channel or the cursor.
   *
   * @param {boolean} [aloud] whether a screen reader announces the values: not for mouse moves and new samples
   */
  refresh(aloud = false) {
    this.element.setAttribute("aria-live", aloud ? "polite" : "off");
    clearTimeout(this.timer);
    this.asking.abort();
    const { side } = this;
    const at = side.played && !side.film ? null : this.at;
    this.hint.hidden = at !== null;
    this.line.hidden = at === null;
    if (!at) return;
    const { samples } = (side.played ?? side.live.film).at(at.x, at.y);
    this.show(side.film?.at(at.x, at.y).rgb.map(radiance) ?? [], samples, false);
    const { channel } = side.state.value;
    const isNow = side.live instanceof LiveFilm && !side.played;
    if (isNow && samples && channel !== DENOISED && channel !== DENOISED_MIX) this.timer = setTimeout(() => this.ask(at, channel), REST_MS);
  }

  /** @param {{x: number, y: number}} at @param {string} channel */
  async ask(at, channel) {
    this.asking = new AbortController();
    try {
      const pixel = await getPixel(this.side.live, at.x, at.y, this.asking.signal);
      this.show(textsOf(pixel, channel, this.side.mix), pixel.samples, true);
    } catch {
      // The cursor has moved, or the connection is lost, as the banner shows: the page's value stays.
    }
  }

  /**
   * @param {string[]} texts
   * @param {number} samples
   * @param {boolean} exact
   */
  show(texts, samples, exact) {
    const { channel } = this.side.state.value;
    const isDenoised = channel === DENOISED_MIX ? this.side.hasCleanPlanes : channel === DENOISED && this.side.fetched !== null;
    const names = channelOf(channel).values;
    setText(this.place, `${this.at?.x}, ${this.at?.y}`);
    this.values.forEach(({ name, value }, i) => {
      setText(name, texts[i] === undefined ? "" : (names[i] ?? ""));
      setText(value, texts[i] ?? "");
    });
    const { live } = this.side;
    const taken = live.hasSamples === false ? "" : tn(samples, "{n} sample", "{n} samples", { n: count(samples) });
    setText(this.samples, [taken, isDenoised && t("denoised")].filter(Boolean).join(", "));
    this.line.classList.toggle("exact", exact);
    this.line.title = exact ? t("Exact values of the film, linear Rec.709") : t("Values of the live picture, accurate to 0.2 %");
  }
}

/**
 * Formats a pixel's values of a channel.
 *
 * @param {import("../base/types.js").PixelValue} pixel
 * @param {string} channel
 * @param {readonly import("./light-mix.js").Strip[]} mix of the channel MIX
 * @returns {string[]}
 */
function textsOf(pixel, channel, mix) {
  if (channel === MIX) return mixPixel(pixel.lights ?? {}, mix).map(radiance);
  const group = lightGroupOf(channel);
  const value = group === null ? pixel[channel || "color"] : pixel.lights?.[group];
  if (channel === "object" || channel === "material")
    return [value == null ? t("none") : `${value} ${pixel[`${channel}_name`] ?? ""}`];
  if (value == null) return [t("not known yet")];
  if (channel === "samples") return [count(Number(value))];
  return [value].flat().map(Number).map(radiance);
}
