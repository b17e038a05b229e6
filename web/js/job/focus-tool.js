/**
 * The focus rectangle, a part of the picture that is rendered first: drawn with Shift or with the tool, and marked while active.
 * The final picture does not change.
 */

import { isShot } from "../base/shot-words.js";
import { h, setText } from "../base/dom.js";
import { drawsRegions } from "../film/region.js";
import { icon } from "../base/icons.js";
import { announce } from "../shell/tray.js";
import { change } from "./job-panel.js";
import { toolWord } from "./picture-tools.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../film/region.js").Rect} Rect */

const OPEN = ["queued", "running", "paused"];
const COLOUR = "#ffd166";

/**
 * @param {Job} job
 * @param {import("../film/live-picture.js").LivePicture} picture
 * @param {import("../base/store.js").Disposer} life
 */
export function focusTool(job, picture, life) {
  const { view, live } = picture;
  let latest = job;
  let isOn = false;
  const button = h(
    "button",
    { class: "icon-button for-submit part-first", type: "button", "aria-pressed": "false", "aria-label": t("Render a region first"), onclick: () => turn(!isOn) },
    icon("region"),
    toolWord(t("Region first")),
  );
  const said = h("span");
  const end = h(
    "button",
    { class: "icon-button for-submit", type: "button", "aria-label": t("Render the whole picture equally again"), title: t("Render the whole picture equally again (Shift+A)"), onclick: () => ask(null) },
    icon("close"),
  );
  const chip = h("div", { class: "stage-chip", role: "status", hidden: true }, said, end);
  picture.element.append(chip);

  /** @param {boolean} on */
  const turn = (on) => {
    isOn = on && !button.disabled;
    button.setAttribute("aria-pressed", String(isOn));
    view?.element.classList.toggle("selecting", isOn);
    show();
  };
  /** @param {Rect | null} rect */
  const ask = (rect) => {
    turn(false);
    const focus = rect && /** @type {[number, number, number, number]} */ ([rect.x, rect.y, rect.w, rect.h]);
    const first = isShot(latest) ? { first: rect ? live.frame : -1 } : {};
    announce(rect ? t("This region is rendered first") : t("The whole picture is rendered equally"));
    void change(latest, { focus, ...first }, t("The order was not changed"));
  };
  const show = () => {
    const { focus } = latest;
    const isOpen = OPEN.includes(latest.state);
    button.disabled = !isOpen; // it keeps its place, as the others do
    button.title = isOpen ? t("Render a region first: click or drag on the picture (A); Shift and drag does it at once") : t("Render a region first: only before the picture is finished");
    const rect = isOpen && focus ? { x: focus[0], y: focus[1], w: focus[2], h: focus[3] } : null;
    // A click selects the pixel's tile.
    const side = latest.tile_size ?? 0;
    const marked = rect && rect.w * rect.h === 1 && side ? tileOf(rect, side, latest) : rect;
    view?.over.setMark("focus", marked && ((over) => over.strokeTwice(marked.x, marked.y, marked.w, marked.h, { colour: COLOUR, dash: true })));
    setText(said, isOn ? t("Click or drag: what is to be rendered first") : marked ? t("First: {w}×{h} at {x}, {y}", { w: marked.w, h: marked.h, x: marked.x, y: marked.y }) : "");
    chip.hidden = !said.textContent;
    end.hidden = isOn;
  };

  if (view) {
    const wanted = (/** @type {PointerEvent} */ { shiftKey }) => isOn || shiftKey;
    life.add(drawsRegions(view, { wanted, chosen: (rect) => !button.disabled && ask(rect) }));
    life.add(live.onTurn(show));
  }
  show();
  return {
    button,
    /** @type {import("../shell/shortcuts.js").Shortcut[]} */
    keys: [
      { keys: "A", does: t("Render a region first: then click or drag on the picture"), run: () => turn(!isOn) },
      { keys: "Shift+A", does: t("Render the whole picture equally again"), run: () => (latest.focus ? ask(null) : turn(false)) },
    ],
    /** @param {Job} next */
    update(next) {
      latest = next;
      if (isOn && !OPEN.includes(next.state)) turn(false);
      show();
    },
  };
}

/**
 * Returns the tile that contains a pixel.
 *
 * @param {Rect} at
 * @param {number} side
 * @param {Job} job
 * @returns {Rect}
 */
function tileOf(at, side, { width, height }) {
  const x = at.x - (at.x % side);
  const y = at.y - (at.y % side);
  return { x, y, w: Math.min(side, (width ?? x + side) - x), h: Math.min(side, (height ?? y + side) - y) };
}
