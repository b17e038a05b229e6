/** Pixels that stay pinned: marked on the picture, their exact values listed, and what each has to the first of them. */

import { getPixel } from "../news/api.js";
import { fill, h, setText } from "../base/dom.js";
import { radiance } from "../base/format.js";
import { icon } from "../base/icons.js";
import { announce } from "../shell/tray.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/store.js").Store<import("./display-panel.js").Display>} DisplayStore */
/** @typedef {{x: number, y: number}} Pin */

const MOST = 12;
const RENEW_MS = 1000;

/** @param {string | null} text of the URL: x,y;x,y @returns {Pin[]} */
export function pinsFrom(text) {
  const found = (text ?? "").split(";").map((pair) => pair.split(",").map(Number));
  return found.flatMap(([x = NaN, y = NaN]) => (Number.isInteger(x) && Number.isInteger(y) && x >= 0 && y >= 0 ? [{ x, y }] : [])).slice(0, MOST);
}

/** @param {Pin[]} pins @returns {string | null} for the URL */
export const pinsText = (pins) => pins.map(({ x, y }) => `${x},${y}`).join(";") || null;

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
    { class: "side-section stack tight", "aria-label": t("Pinned pixels"), hidden: true },
    h("div", { class: "row spread" }, h("h2", null, t("Pinned pixels")), clear),
    rows,
  );
  const set = (/** @type {Pin[]} */ pins) => display.update((look) => ({ ...look, pins }));
  const toggle = (/** @type {Pin} */ { x, y }) => {
    const { pins } = display.value;
    const without = pins.filter((pin) => pin.x !== x || pin.y !== y);
    if (without.length === pins.length && pins.length === MOST) {
      announce(t("{most} pixels are pinned; remove one first", { most: MOST }));
      return;
    }
    set(without.length < pins.length ? without : [...pins, { x, y }]);
  };

  let asking = new AbortController();
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let waiting;
  life.add(() => (clearTimeout(waiting), asking.abort()));
  /** @type {{pin: Pin, cells: HTMLElement[], ratio: HTMLElement}[]} */
  let shown = [];
  const read = async () => {
    waiting = undefined;
    asking.abort();
    const { signal } = (asking = new AbortController());
    try {
      const values = await Promise.all(shown.map(({ pin }) => getPixel(live, pin.x, pin.y, signal)));
      const lights = values.map(({ color }) => {
        const [r = 0, g = 0, b = 0] = /** @type {number[]} */ (color);
        return [r, g, b, 0.2126 * r + 0.7152 * g + 0.0722 * b];
      });
      lights.forEach((light, i) => {
        const told = `${t("{n} samples", { n: values[i]?.samples ?? 0 })}${values[i]?.object_name ? `, ${values[i].object_name}` : ""}`;
        const first = lights[0]?.[3] ?? 0;
        const ratio = i && first > 0 ? t("{n} × the first", { n: ((light[3] ?? 0) / first).toPrecision(3) }) : "";
        shown[i]?.cells.forEach((cell, c) => {
          setText(cell, radiance(light[c] ?? 0));
          cell.title = told;
        });
        setText(shown[i]?.ratio ?? element, ratio);
      });
    } catch {
      // Gone on, or cut off: what was read stays.
    }
  };
  const soon = () => {
    if (shown.length && waiting === undefined) waiting = setTimeout(read, RENEW_MS);
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
      shown = pins.map((pin) => ({ pin, cells: Array.from({ length: 4 }, () => h("dd", null, "…")), ratio: h("span", { class: "quiet grow" }) }));
      fill(
        rows,
        ...shown.map(({ pin, cells, ratio }, i) => {
          const name = t("Remove the pin at {x}, {y}", { x: pin.x, y: pin.y });
          const remove = h("button", { class: "icon-button", type: "button", "aria-label": name, title: name, onclick: () => toggle(pin) }, icon("close"));
          const why = t("Explain the pixel {x}, {y}", { x: pin.x, y: pin.y });
          const ask = h("button", { class: "icon-button", type: "button", "aria-label": why, title: why, onclick: () => explain(pin) }, icon("path"));
          const who = t("The log of the tile with {x}, {y}", { x: pin.x, y: pin.y });
          const log = h("button", { class: "icon-button", type: "button", "aria-label": who, title: who, onclick: () => tell(pin) }, icon("lines"));
          return h(
            "li",
            null,
            h("div", { class: "row" }, h("strong", null, String(i + 1)), h("span", null, `${pin.x}, ${pin.y}`), ratio, log, ask, remove),
            h("dl", null, cells.map((cell, c) => h("div", null, h("dt", null, "RGBY"[c] ?? ""), cell))),
          );
        }),
      );
      view?.over.setMark("pins", pins.length ? (over, ratio) => pins.forEach((pin, i) => drawPin(over, ratio, pin, i + 1)) : null);
      void read();
    }),
  );

  /** What a click on the picture does, while the tool is on. */
  let isOn = false;
  const button = h("button", { class: "icon-button", type: "button", "aria-pressed": "false", "aria-label": t("Pin pixels"), onclick: () => turn(!isOn) }, icon("pin"));
  button.title = t("Pin pixels: click on the picture to pin a pixel or let it go (V pins the one under the cursor)");
  const turn = (/** @type {boolean} */ on) => {
    isOn = on;
    button.setAttribute("aria-pressed", String(on));
  };
  if (view) {
    /** @type {{x: number, y: number} | null} */
    let from = null;
    life.listen(view.element, "pointerdown", (/** @type {PointerEvent} */ event) => {
      from = isOn && event.button === 0 && !event.shiftKey ? { x: event.clientX, y: event.clientY } : null;
    });
    life.listen(view.element, "pointerup", (/** @type {PointerEvent} */ event) => {
      const still = from && Math.hypot(event.clientX - from.x, event.clientY - from.y) < 4;
      from = null;
      if (still && view.over.cursor) toggle(view.over.cursor);
    });
  }
  return {
    element,
    button,
    /** @type {import("../shell/shortcuts.js").Shortcut[]} */
    keys: [
      { keys: "V", does: t("Pin the pixel under the cursor, or let it go"), run: () => view?.over.cursor && toggle(view.over.cursor) },
      { keys: "Shift+V", does: t("Let all pinned pixels go"), run: () => set([]) },
    ],
  };
}

/**
 * @param {import("../film/pixel-overlay.js").PixelOverlay} over
 * @param {number} ratio
 * @param {Pin} pin
 * @param {number} number
 */
function drawPin(over, ratio, { x, y }, number) {
  const { context, viewport } = over;
  const cx = viewport.x + (x + 0.5) * viewport.scale;
  const cy = viewport.y + (y + 0.5) * viewport.scale;
  const arm = Math.max(5 * ratio, viewport.scale / 2);
  for (const [style, line] of /** @type {const} */ ([
    ["rgb(0 0 0 / 0.75)", 3 * ratio],
    ["#fff", 1.25 * ratio],
  ])) {
    context.strokeStyle = style;
    context.lineWidth = line;
    context.beginPath();
    context.arc(cx, cy, arm, 0, 2 * Math.PI);
    context.stroke();
  }
  context.font = `600 ${11 * ratio}px system-ui, sans-serif`;
  over.text(String(number), cx + arm + 3 * ratio, cy + 4 * ratio, "#fff", ratio);
}
