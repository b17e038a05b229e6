/** Probes, which are pinned pixels and areas: marked on the picture, with their values and the ratio to the first one. */

import { getPixel } from "../news/api.js";
import { areaOf } from "../film/area.js";
import { SANS } from "../film/pixel-overlay.js";
import { drawsRegions } from "../film/region.js";
import { luminanceOf } from "../base/colour.js";
import { fill, h, setText } from "../base/dom.js";
import { percent, radiance, stops } from "../base/format.js";
import { icon } from "../base/icons.js";
import { announce } from "../shell/tray.js";
import { toolWord } from "./picture-tools.js";
import { grouped, t, tn } from "../base/words.js";

/** @typedef {import("../base/store.js").Store<import("./display-panel.js").Display>} DisplayStore */
/** A pixel, or an area with its size. @typedef {{x: number, y: number, w?: number, h?: number}} Pin */
/** The values read at a pin. @typedef {{light: number[], about: string, title: string}} Reading */

const MOST = 12;
const RENEW_MS = 1000;

/** @param {string | null} text of the URL: x,y;x,y,w,h @returns {Pin[]} */
export function pinsFrom(text) {
  const found = (text ?? "").split(";").map((pin) => pin.split(",").map(Number));
  return found
    .filter((numbers) => [2, 4].includes(numbers.length) && numbers.every((n) => Number.isInteger(n) && n >= 0) && numbers.slice(2).every((n) => n > 0))
    .map(([x = 0, y = 0, w, h]) => (w && h ? { x, y, w, h } : { x, y }))
    .slice(0, MOST);
}

/** @param {Pin[]} pins @returns {string | null} for the URL */
export const pinsText = (pins) => pins.map(keyOf).join(";") || null;

/** A pin as text for the URL. @param {Pin} pin */
export const keyOf = ({ x, y, w, h }) => (w ? `${x},${y},${w},${h}` : `${x},${y}`);

/**
 * The part of a pinned area inside a film; empty for a pixel.
 *
 * @param {Pin} pin
 * @param {{width: number, height: number}} film
 * @returns {import("../film/region.js").Rect | undefined}
 */
export function areaWithin({ x, y, w, h }, { width, height }) {
  return w && h && x < width && y < height ? { x, y, w: Math.min(w, width - x), h: Math.min(h, height - y) } : undefined;
}

/**
 * @param {import("../film/live-picture.js").LivePicture} picture
 * @param {DisplayStore} display
 * @param {import("../base/store.js").Disposer} life
 * @param {(pin: Pin) => void} explain
 * @param {(pin: Pin) => void} tell the log of its tile
 */
export function pinsPanel(picture, display, life, explain, tell) {
  const { view, live } = picture;
  const rows = h("ol", { class: "pins number" });
  const clear = h("button", { class: "text-button small", type: "button", onclick: () => set([]) }, t("Remove all"));
  const element = h(
    "section",
    { class: "side-section stack tight", "aria-label": t("Inspected pixels"), hidden: true },
    h("div", { class: "row spread" }, h("h2", null, t("Inspected pixels")), clear),
    rows,
  );
  const set = (/** @type {Pin[]} */ pins) => display.update((look) => ({ ...look, pins }));
  const toggle = (/** @type {Pin} */ pin) => {
    const { pins } = display.value;
    const without = pins.filter((other) => keyOf(other) !== keyOf(pin));
    if (without.length === pins.length && pins.length === MOST) {
      announce(t("{most} places are inspected already; remove one first", { most: MOST }));
      return;
    }
    set(without.length < pins.length ? without : [...pins, pin]);
  };
  /** Keyboard alternative: the area between the last pin and the cursor. */
  const stretch = () => {
    const { pins } = display.value;
    const from = pins.at(-1);
    const to = view?.over.cursor;
    if (!from || from.w || !to || (from.x === to.x && from.y === to.y)) {
      announce(t("Inspect one corner with V, go to the other, then press G"));
      return;
    }
    const area = { x: Math.min(from.x, to.x), y: Math.min(from.y, to.y), w: Math.abs(from.x - to.x) + 1, h: Math.abs(from.y - to.y) + 1 };
    set([...pins.slice(0, -1), area]);
  };

  let asking = new AbortController();
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let waiting;
  life.add(() => (clearTimeout(waiting), asking.abort()));
  /** @type {PinRow[]} */
  let shown = [];
  /** Whether a request is in progress, and whether the film has changed since. */
  let [isAsked, isOld] = [false, false];
  const showAll = () => {
    const first = luminanceOf(shown[0]?.reading?.light ?? []);
    shown.forEach((row, i) => row.show(i && row.reading ? ratioWords(luminanceOf(row.reading.light), first) : ""));
  };
  const read = async () => {
    clearTimeout(waiting);
    waiting = undefined;
    asking.abort();
    const { signal } = (asking = new AbortController());
    [isAsked, isOld] = [true, false];
    for (const row of shown) if (row.pin.w) row.reading = readingOfArea(live.film, row.pin);
    showAll();
    try {
      const pixels = shown.filter(({ pin }) => !pin.w);
      const readings = await Promise.all(pixels.map(({ pin }) => readingOfPixel(live, pin, signal)));
      pixels.forEach((row, i) => (row.reading = readings[i] ?? null));
      showAll();
    } catch {
      // Another frame, or the connection is lost: the previous values stay.
    }
    if (signal.aborted) return;
    isAsked = false;
    if (isOld) soon();
  };
  // Waits for a slow response, since repeating the request with every tile would never finish.
  const soon = () => {
    if (isAsked) isOld = true;
    else if (shown.length) waiting ??= setTimeout(read, RENEW_MS);
  };
  life.add(live.onTile(soon));
  life.add(live.onFill(soon));
  life.add(live.onTurn(() => void read()));

  let key = "";
  life.add(
    display.subscribe(({ pins }) => {
      const now = pinsText(pins) ?? "";
      if (now === key && shown.length === pins.length) return;
      key = now;
      element.hidden = pins.length === 0;
      shown = pins.map((pin, i) => pinRow(pin, i + 1, { remove: toggle, explain, tell }));
      fill(rows, ...shown.map((row) => row.element));
      view?.over.setMark("pins", pins.length ? (over, ratio) => pins.forEach((pin, i) => drawPin(over, ratio, pin, i + 1)) : null);
      void read();
    }),
  );

  /** Whether the tool is active, so that a click or drag sets a pin. */
  let isOn = false;
  const button = h("button", { class: "icon-button", type: "button", "aria-pressed": "false", "aria-label": t("Inspect pixels"), onclick: () => turn(!isOn) }, icon("probe"), toolWord(t("Inspect")));
  button.title = t("Inspect: click a pixel to keep its values in view, click it again to remove it (V: at the cursor); drag to measure an area");
  const turn = (/** @type {boolean} */ on) => {
    isOn = on;
    button.setAttribute("aria-pressed", String(on));
    view?.element.classList.toggle("measuring", on);
  };
  if (view) {
    const chosen = (/** @type {import("../film/region.js").Rect} */ { x, y, w, h }) => toggle(w * h > 1 ? { x, y, w, h } : { x, y });
    life.add(drawsRegions(view, { wanted: ({ shiftKey }) => isOn && !shiftKey, chosen }));
  }
  return {
    element,
    button,
    /** @type {import("../shell/shortcuts.js").Shortcut[]} */
    keys: [
      { keys: "V", does: t("Inspect the pixel under the cursor, or remove it"), run: () => view?.over.cursor && toggle(view.over.cursor) },
      { keys: "G", does: t("Measure the area from the last inspected pixel to the cursor"), run: stretch },
      { keys: "Shift+V", does: t("Remove all inspected pixels"), run: () => set([]) },
    ],
  };
}

/**
 * A pin's row in the list.
 *
 * @typedef {{pin: Pin, element: HTMLElement, reading: Reading | null, show: (ratio: string) => void}} PinRow reading: null until there is one
 *
 * @param {Pin} pin
 * @param {number} number
 * @param {{remove: (pin: Pin) => void, explain: (pin: Pin) => void, tell: (pin: Pin) => void}} deeds
 * @returns {PinRow}
 */
function pinRow(pin, number, { remove, explain, tell }) {
  const { x, y, w, h: high } = pin;
  const cells = Array.from({ length: 4 }, () => h("dd", null, "…"));
  const about = h("p", { class: "quiet", hidden: true });
  const button = (/** @type {import("../base/icons.js").IconName} */ sign, /** @type {string} */ name, /** @type {(pin: Pin) => void} */ run) =>
    h("button", { class: "icon-button", type: "button", "aria-label": name, title: name, onclick: () => run(pin) }, icon(sign));
  const ofPixel = [
    button("lines", t("The log of the tile with {x}, {y}", { x, y }), tell),
    button("path", t("Show the paths of pixel {x}, {y}", { x, y }), explain),
  ];
  const element = h(
    "li",
    null,
    h(
      "div",
      { class: "row" },
      ...[h("strong", null, String(number)), h("span", null, w ? t("{w}×{h} at {x}, {y}", { w, h: high ?? 0, x, y }) : `${x}, ${y}`)],
      h("span", { class: "grow" }),
      w ? [] : ofPixel,
      button("close", t("Stop inspecting {x}, {y}", { x, y }), remove),
    ),
    h("dl", null, cells.map((cell, c) => h("div", null, h("dt", null, "RGBY"[c] ?? ""), cell))),
    about,
  );
  return {
    pin,
    element,
    reading: null,
    show(of) {
      if (!this.reading) return;
      const { light, about: words, title } = this.reading;
      [...light, luminanceOf(light)].forEach((value, c) => {
        const cell = cells[c];
        if (!cell) return;
        setText(cell, radiance(value));
        cell.title = title;
      });
      setText(about, [of, words].filter(Boolean).join(" · "));
      about.hidden = !about.textContent;
    },
  };
}

/** The ratio of a light to the first, as a factor and in stops. @param {number} light @param {number} first */
function ratioWords(light, first) {
  if (!(first > 0)) return "";
  const factor = t("{n} × the first", { n: (light / first).toPrecision(3) });
  return light > 0 ? `${factor}, ${stops(Math.log2(light / first))} EV` : factor;
}

/**
 * @param {import("../film/live-film.js").LiveFilm} live
 * @param {Pin} pin
 * @param {AbortSignal} signal
 * @returns {Promise<Reading>}
 */
async function readingOfPixel(live, { x, y }, signal) {
  const { color, samples, object_name } = await getPixel(live, x, y, signal);
  return { light: /** @type {number[]} */ (color), about: "", title: `${tn(samples, "{n} sample", "{n} samples", { n: samples })}${object_name ? `, ${object_name}` : ""}` };
}

/** @param {import("../film/film.js").Film} film @param {Pin} pin @returns {Reading} */
function readingOfArea(film, { x, y, w = 1, h = 1 }) {
  const { rgb, least, most, luminance, spread, pixels } = areaOf(film, { x, y, w, h });
  const about = pixels
    ? t("Luminance from {least} to {most}, spread {spread}", { least: radiance(least), most: radiance(most), spread: percent(luminance && spread / luminance) })
    : t("No samples yet");
  return { light: rgb, about, title: t("The mean of {n} pixels", { n: grouped(pixels) }) };
}

/**
 * @param {import("../film/pixel-overlay.js").PixelOverlay} over
 * @param {number} ratio
 * @param {Pin} pin
 * @param {number} number
 */
function drawPin(over, ratio, { x, y, w, h }, number) {
  const { context, viewport } = over;
  if (w && h) over.strokeTwice(x, y, w, h);
  const cx = viewport.x + (w ? x + w : x + 0.5) * viewport.scale;
  const cy = viewport.y + (h ? y + h / 2 : y + 0.5) * viewport.scale;
  const arm = w ? 0 : Math.max(5 * ratio, viewport.scale / 2);
  for (const [style, line] of /** @type {const} */ ([
    ["rgb(0 0 0 / 0.75)", 3 * ratio],
    ["#fff", 1.25 * ratio],
  ])) {
    if (!arm) break;
    context.strokeStyle = style;
    context.lineWidth = line;
    context.beginPath();
    context.arc(cx, cy, arm, 0, 2 * Math.PI);
    context.stroke();
  }
  context.font = `600 ${12 * ratio}px ${SANS}`;
  over.text(String(number), cx + arm + 3 * ratio, cy + 4 * ratio, "#fff", ratio);
}
