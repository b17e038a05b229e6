/** The histogram of a picture's pixels after exposure, in stops, updated as samples arrive. */

import { HIGHEST, LOWEST, histogramOf } from "../film/histogram.js";
import { areaWithin, keyOf } from "./pins.js";
import { fill, h, setText } from "../base/dom.js";
import { withFold } from "../shell/layouts.js";
import { t } from "../base/words.js";

/** @typedef {import("../film/live-film.js").LiveFilm} LiveFilm */
/** @typedef {import("../base/store.js").Store<import("./display-panel.js").Display>} DisplayStore */

const RENEW_MS = 500;
const HEIGHT = 96;
/** Smaller shares are not visible on the logarithmic scale. */
const FLOOR = 1e-5;
const LINES = /** @type {const} */ ([
  ["R", "#ff5a4f"],
  ["G", "#3ec46d"],
  ["B", "#5b9bff"],
]);

/**
 * @param {LiveFilm} live
 * @param {DisplayStore} display
 * @param {import("../base/store.js").Disposer} life
 */
export function histogramPanel(live, display, life) {
  const canvas = h("canvas", { role: "img", "aria-label": t("Histogram") });
  const told = h("p", { class: "quiet small number" });
  const log = h("input", { type: "checkbox", onchange: () => draw() });
  const part = h("select", { "aria-label": t("Histogram of"), hidden: true, onchange: () => draw() });
  const body = h(
    "div",
    { class: "stack tight" },
    part,
    canvas,
    h("div", { class: "ticks quiet small number", "aria-hidden": "true" }, ["−12", "−9", "−6", "−3", "1.0", "+3", "+6"].map((text) => h("span", null, text))),
    told,
    h("label", { class: "check" }, log, t("Logarithmic")),
  );
  const element = withFold("histogram", h("details", { class: "side-section histogram" }, h("summary", null, h("h2", null, t("Histogram"))), body));
  element.addEventListener("toggle", () => draw());

  let drawnAt = -Infinity;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let waiting;
  life.add(() => clearTimeout(waiting));
  const soon = () => {
    if (!element.open || waiting !== undefined) return;
    waiting = setTimeout(draw, Math.max(0, RENEW_MS - (performance.now() - drawnAt)));
  };
  const draw = () => {
    clearTimeout(waiting);
    waiting = undefined;
    if (!element.open) return;
    drawnAt = performance.now();
    const chosen = display.value.pins.find((pin) => keyOf(pin) === part.value);
    const { channels, black, above, pixels } = histogramOf(live.film, display.value.exposure, chosen && areaWithin(chosen, live.film));
    const ratio = devicePixelRatio;
    const width = Math.max(1, Math.round(canvas.clientWidth * ratio));
    const height = HEIGHT * ratio;
    Object.assign(canvas, { width, height });
    const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    const ink = getComputedStyle(canvas).color;
    const most = Math.max(...channels.map((channel) => Math.max(...channel)), FLOOR);
    const level = (/** @type {number} */ share) =>
      log.checked ? Math.max(0, Math.log(share / FLOOR) / Math.log(most / FLOOR)) : share / most;
    // Position of the display's white.
    const white = (-LOWEST / (HIGHEST - LOWEST)) * width;
    context.globalAlpha = 0.35;
    context.fillStyle = ink;
    context.fillRect(Math.round(white), 0, ratio, height);
    const path = (/** @type {Float64Array} */ channel) => {
      context.beginPath();
      context.moveTo(0, height);
      channel.forEach((share, i) => context.lineTo(((i + 0.5) / channel.length) * width, height - level(share) * (height - 2 * ratio)));
      context.lineTo(width, height);
    };
    const [r, g, b, y] = channels;
    if (y) {
      path(y);
      context.globalAlpha = 0.22;
      context.fill();
    }
    context.globalAlpha = 1;
    context.lineWidth = 1.25 * ratio;
    [r, g, b].forEach((channel, i) => {
      context.strokeStyle = LINES[i]?.[1] ?? ink;
      if (channel) path(channel);
      context.stroke();
    });
    const percent = (/** @type {number} */ share) => `${(share * 100).toFixed(share > 0 && share < 0.1 ? 1 : 0)} %`;
    const words = pixels ? t("{above} above white, {black} black", { above: percent(above), black: percent(black) }) : t("No samples yet");
    setText(told, t("{words}. Lines: R, G, B; filled: luminance; stops after exposure.", { words }));
    canvas.setAttribute("aria-label", t("Histogram of red, green, blue and luminance: {words}", { words }));
  };
  let offered = "";
  const offer = () => {
    const areas = display.value.pins.flatMap((pin, i) => (areaWithin(pin, live.film) ? [{ key: keyOf(pin), number: i + 1 }] : []));
    const key = JSON.stringify(areas);
    if (key === offered) return;
    offered = key;
    const was = part.value;
    fill(
      part,
      h("option", { value: "" }, t("The whole picture")),
      areas.map((area) => h("option", { value: area.key }, t("The area {n}", { n: area.number }))),
    );
    part.value = areas.some((area) => area.key === was) ? was : "";
    part.hidden = areas.length === 0;
  };
  life.add(display.subscribe(offer));
  life.add(live.onTile(soon));
  life.add(live.onFill(soon));
  life.add(live.onTurn(soon));
  life.add(display.subscribe(soon));
  const resizing = new ResizeObserver(soon);
  resizing.observe(canvas);
  life.add(() => resizing.disconnect());
  return element;
}
