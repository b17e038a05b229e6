/**
 * The scene in the hand: dragging turns the view, the farm renders a small picture of it at once, and what is seen is what
 * the form asks for. A click, where it is asked for, puts the focus onto what lies there.
 */

import { getPixel } from "../news/api.js";
import { h, setText } from "../base/dom.js";
import { CannotShow, FilmCanvas } from "../film/film-canvas.js";
import { icon } from "../base/icons.js";
import { alongSight, dolly, orbit, pan } from "./orbit.js";
import { Preview } from "./preview.js";
import { showError } from "../shell/tray.js";
import { Viewport } from "../film/viewport.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").JobRequest} JobRequest */

/** Radians that a drag over the picture's height turns by. */
const TURN = Math.PI;
const KEY_STEP = 0.04;
/** A wheel's notch, 100 or 120, is a seventh nearer or farther. */
const DOLLY_PER_PIXEL = 0.0013;
const KEY_DOLLY = 1.1;

/**
 * @param {{view: () => View, request: () => JobRequest, turn: (view: View) => void, focus: (distance: number) => void}} form
 * @param {number} aspect of the picture
 * @param {string} meanwhile a picture's address, shown until the first preview is here; "" for none
 * @param {() => void} done the user has found the view
 * @returns {{element: HTMLElement, refresh: () => void, dispose: () => void}} refresh: the form was changed
 */
export function viewTurner(form, aspect, meanwhile, done) {
  const canvas = h("canvas", { role: "img", "aria-label": "Preview of the view" });
  const over = h("canvas", { hidden: true });
  const surface = h(
    "div",
    {
      class: "turner",
      tabindex: "0",
      role: "application",
      "aria-label": "Turn the view: arrows turn, Shift and arrows move, plus and minus go nearer and farther",
    },
    canvas,
    over,
  );
  const said = h("p", { class: "small quiet", role: "status" });
  const pick = h(
    "button",
    { class: "button", type: "button", "aria-pressed": "false" },
    icon("target"),
    "Pick the focus",
  );
  const element = h(
    "div",
    { class: "turner-box" },
    surface,
    h(
      "div",
      { class: "row turner-bar" },
      said,
      h("span", { class: "grow" }),
      pick,
      h("button", { class: "button primary", type: "button", onclick: done }, icon("check"), "Done"),
    ),
  );
  const viewport = new Viewport();
  /** @type {FilmCanvas} */
  let picture;
  try {
    picture = new FilmCanvas(canvas, over, viewport);
  } catch (error) {
    if (!(error instanceof CannotShow)) throw error;
    setText(said, error.message);
    return { element, refresh: () => {}, dispose: () => {} };
  }
  const preview = new Preview(aspect, {
    shown: (film) => {
      if (picture.layers[0].film) picture.layers[0].upload();
      else picture.layers[0].setFilm(film);
    },
    failed: (error) => showError("The view could not be previewed", error),
  });
  const { size } = preview;
  picture.setPicture(size.width, size.height);
  // Until the first samples are here: better another view of the scene than a black one.
  if (meanwhile) surface.style.backgroundImage = `url("${meanwhile}")`;
  surface.style.aspectRatio = `${size.width} / ${size.height}`;
  const resizing = new ResizeObserver(() => {
    picture.resize();
    viewport.show(
      Math.min(viewport.canvas.width / size.width, viewport.canvas.height / size.height),
      size.width / 2,
      size.height / 2,
    );
    picture.draw();
  });
  resizing.observe(surface);

  const refresh = () => {
    preview.show(form.request());
    const canFocus = (form.view().projection ?? "perspective") === "perspective";
    pick.hidden = !canFocus;
    if (!canFocus) setPicking(false);
  };
  /** @param {View} view */
  const turn = (view) => {
    form.turn(view);
    refresh();
  };

  let picking = false;
  const setPicking = (/** @type {boolean} */ on) => {
    picking = on;
    pick.setAttribute("aria-pressed", String(on));
    surface.classList.toggle("picking", on);
    setText(
      said,
      on
        ? "Click what is to be sharp."
        : "Drag turns, with Shift or two fingers it moves; the wheel goes nearer and farther.",
    );
  };
  pick.addEventListener("click", () => setPicking(!picking));
  setPicking(false);

  /** @param {PointerEvent} event */
  const focusAt = async (event) => {
    const { place } = preview;
    if (!place) return;
    const box = surface.getBoundingClientRect();
    const at = {
      x: Math.floor(((event.clientX - box.left) / box.width) * size.width),
      y: Math.floor(((event.clientY - box.top) / box.height) * size.height),
    };
    try {
      const { depth } = await getPixel(place, at.x, at.y, new AbortController().signal);
      if (typeof depth !== "number" || depth <= 0) {
        setText(said, "Nothing is there to focus on. Click an object.");
        return;
      }
      const distance = alongSight(form.view(), size, at, depth);
      form.focus(distance);
      setPicking(false);
      refresh();
      const told = `Sharp at a distance of ${distance.toPrecision(4)}.`;
      setText(said, form.view().aperture ? told : `${told} Give the lens an aperture to see it.`);
    } catch (error) {
      showError("The focus was not set", error);
    }
  };

  /** Pointers that are down, at their last place. @type {Map<number, {x: number, y: number}>} */
  const down = new Map();
  surface.addEventListener("contextmenu", (event) => event.preventDefault());
  surface.addEventListener("pointerdown", (event) => {
    if (picking) {
      void focusAt(event);
      return;
    }
    surface.setPointerCapture(event.pointerId);
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  surface.addEventListener("pointermove", (event) => {
    const before = down.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY };
    const height = surface.clientHeight;
    const dx = (now.x - before.x) / height;
    const dy = (now.y - before.y) / height;
    const view = form.view();
    down.set(event.pointerId, now);
    if (down.size > 1) {
      const other = [...down].find(([id]) => id !== event.pointerId)?.[1] ?? now;
      const apart = (/** @type {{x: number, y: number}} */ p) => Math.max(1, Math.hypot(p.x - other.x, p.y - other.y));
      turn(dolly(pan(view, dx / 2, dy / 2), apart(before) / apart(now)));
    } else if (event.shiftKey || event.buttons & 6) {
      turn(pan(view, dx, dy));
    } else {
      turn(orbit(view, dx * TURN, dy * TURN));
    }
  });
  for (const type of /** @type {const} */ (["pointerup", "pointercancel"]))
    surface.addEventListener(type, (event) => down.delete(event.pointerId));
  surface.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? event.deltaY * 16 : event.deltaY;
      turn(dolly(form.view(), Math.exp(pixels * DOLLY_PER_PIXEL)));
    },
    { passive: false },
  );
  surface.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const move = event.shiftKey ? pan : orbit;
    const step = event.shiftKey ? KEY_STEP : KEY_STEP * TURN;
    const view = form.view();
    /** @type {Record<string, () => View>} */
    const moves = {
      ArrowLeft: () => move(view, -step, 0),
      ArrowRight: () => move(view, step, 0),
      ArrowUp: () => move(view, 0, -step),
      ArrowDown: () => move(view, 0, step),
      "+": () => dolly(view, 1 / KEY_DOLLY),
      "-": () => dolly(view, KEY_DOLLY),
    };
    const made = moves[event.key]?.();
    if (!made) return;
    event.preventDefault();
    turn(made);
  });

  refresh();
  return {
    element,
    refresh,
    dispose() {
      resizing.disconnect();
      preview.dispose();
      picture.dispose();
    },
  };
}
