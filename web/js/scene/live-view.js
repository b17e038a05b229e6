/**
 * The scene as it is seen now: the farm renders what the form asks for while one looks, turns and chooses. It is no job, and
 * nothing of it stays.
 */

import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { CannotShow, FilmCanvas } from "../film/film-canvas.js";
import { Film } from "../film/film.js";
import { CURVES, DEFAULT_CURVE } from "../film/tonemap.js";
import { Viewport } from "../film/viewport.js";
import { parseFrames } from "../base/frame-numbers.js";
import { bookmarks } from "./bookmarks.js";
import { clarity, clearness } from "./clarity.js";
import { enlarged } from "./enlarge.js";
import { alongSight, lookAt } from "./orbit.js";
import { viewHand } from "./view-hand.js";
import { ViewLink } from "./view-link.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").JobRequest} JobRequest */

/** The farm renders no more pixels than these, whatever the screen has. */
const MOST_PIXELS = 1 << 20;
const LEAST_SIDE = 16;
/** What a request says of more than one picture of a few samples. */
const NOT_OF_A_VIEW = ["spp", "noise", "seconds", "frames", "order", "every", "name", "priority", "tile_size", "scene"];

/**
 * @param {import("../base/types.js").Scene} scene
 * @param {import("./settings-form.js").SettingsForm} form
 * @param {string} meanwhile a picture's address, shown until the first one of the view is here; "" for none
 * @param {(view: View) => void} turned by hand
 * @returns {{element: HTMLElement, refresh: () => void, dispose: () => void}} refresh: the form was changed
 */
export function liveView(scene, form, meanwhile, turned) {
  const canvas = h("canvas", { role: "img", "aria-label": t("The scene as it is seen now") });
  const over = h("canvas", { hidden: true });
  const surface = h(
    "div",
    {
      class: "live-view",
      tabindex: "0",
      role: "application",
      "aria-label":
        t("The view. Arrows turn it, Shift and arrows move it, plus and minus go nearer and farther; W, A, S, D, Q and E fly."),
    },
    canvas,
    over,
  );
  const state = h("p", { class: "small quiet number view-state", role: "status" });
  const said = h("p", { class: "small quiet view-hint" });
  const pick = h(
    "button",
    { class: "button small", type: "button", "aria-pressed": "false" },
    icon("target"),
    t("Pick the focus"),
  );
  const exposure = h("input", { type: "range", min: -8, max: 8, step: 0.25, value: "0", "aria-label": t("Exposure in stops") });
  const curve = h(
    "select",
    { "aria-label": t("Tone curve") },
    CURVES.map(({ name, label }) => h("option", { value: name, selected: name === DEFAULT_CURVE }, label)),
  );
  const shown = h("span", { class: "small number quiet" }, "0 EV");
  const clear = clearness(() => refresh());
  const element = h(
    "div",
    { class: "live-view-box" },
    h("div", { class: "live-view-frame" }, surface),
    h("div", { class: "view-bar" }, state, h("span", { class: "grow" }), h("label", { class: "view-exposure" }, icon("sun"), exposure, shown), clear.element, curve, pick),
    h("div", { class: "view-bar" }, bookmarks(scene.id, form.view, (view) => turn(view)), h("span", { class: "grow" }), said),
  );
  const viewport = new Viewport();
  /** @type {FilmCanvas} */
  let picture;
  try {
    picture = new FilmCanvas(canvas, over, viewport);
  } catch (error) {
    if (!(error instanceof CannotShow)) throw error;
    setText(state, error.message);
    return { element, refresh: () => {}, dispose: () => {} };
  }
  // Until the first samples are here: better another view of the scene than a black one.
  if (meanwhile) surface.style.backgroundImage = `url("${meanwhile}")`;

  /** @type {Film | null} */
  let film = null;
  let id = -1;
  /** What was asked for last. */
  let asked = { width: 1, height: 1 };
  /** What to do with the place that the next answer names. @type {((picked: import("./view-link.js").Picked) => void) | null} */
  let onPicked = null;

  const link = new ViewLink(scene.id, {
    picture(next) {
      if (!film || film.width !== next.width || film.height !== next.height) {
        // Tiles that are still to come show what was seen before.
        const covered = next.tiles.reduce((sum, { w, h: rows }) => sum + w * rows, 0);
        const isWhole = covered === next.width * next.height;
        film = film && !isWhole ? enlarged(film, next.width, next.height) : new Film(next.width, next.height);
        fit(next.width, next.height);
        for (const tile of next.tiles) film.put(tile);
        picture.layers[0].setFilm(film);
      } else {
        for (const tile of next.tiles) {
          film.put(tile);
          picture.layers[0].putTile(film, tile);
        }
      }
      id = next.id;
      surface.dataset.view = String(id);
      surface.style.backgroundImage = "";
      picture.invalidate();
    },
    state({ samples, bound, mean, noise, done, slots, message }) {
      surface.dataset.samples = String(samples);
      if (message) setText(state, message);
      else if (bound) setText(state, clarity(mean, noise, done ? null : slots));
    },
    failed: (sentence) => setText(state, sentence),
    picked: (found) => (onPicked?.(found), (onPicked = null)),
    link: (up) => up || setText(state, t("The connection is lost; trying again.")),
    refused: (sentence) => setText(state, sentence),
  });

  /** The canvas has the picture's own pixels, and the page's layout stretches it smoothly. @param {number} width @param {number} height */
  const fit = (width, height) => {
    canvas.width = width;
    canvas.height = height;
    picture.setPicture(width, height);
    viewport.resizeCanvas(width, height);
    viewport.show(1, width / 2, height / 2);
  };

  const refresh = () => {
    if (!form.element.checkValidity()) return;
    /** @type {Record<string, any>} */
    const request = { ...form.request() };
    if (request.frames) request.frame = firstOf(request.frames);
    for (const name of NOT_OF_A_VIEW) delete request[name];
    surface.style.setProperty("--aspect", String((request.width ?? 1) / (request.height ?? 1)));
    const { width, height } = sizeFor(request.width ?? 1, request.height ?? 1, surface);
    asked = { width, height };
    link.show({ ...request, ...clear.request(), width, height });
    const canFocus = (form.view().projection ?? "perspective") === "perspective";
    pick.hidden = !canFocus;
    if (!canFocus) setPicking(false);
    if (focused && form.view().aperture) tell();
  };
  /** @param {View} view */
  const turn = (view) => {
    form.turn(view);
    refresh();
    turned(view);
  };

  let picking = false;
  /** The lens is focused and has no aperture yet, which makes it seen. */
  let focused = false;
  const tell = (/** @type {string} */ sentence = "") => {
    focused = false;
    const touch = matchMedia("(pointer: coarse)").matches;
    const usual = touch
      ? t("Two fingers move the view; tap it to turn it with one.")
      : t("Drag turns, Shift and drag moves, the wheel goes nearer; W A S D Q E fly.");
    setText(said, sentence || usual);
  };
  const setPicking = (/** @type {boolean} */ on) => {
    if (on === picking) return;
    picking = on;
    pick.setAttribute("aria-pressed", String(on));
    surface.classList.toggle("picking", on);
    tell(on ? t("Click what is to be sharp.") : "");
  };
  pick.addEventListener("click", () => setPicking(!picking));
  tell();

  /** @param {MouseEvent} event */
  const pixelAt = (event) => {
    const box = surface.getBoundingClientRect();
    return {
      x: Math.floor(((event.clientX - box.left) / box.width) * asked.width),
      y: Math.floor(((event.clientY - box.top) / box.height) * asked.height),
    };
  };
  /** @param {MouseEvent} event */
  const focusAt = (event) => {
    const at = pixelAt(event);
    onPicked = ({ depth }) => {
      if (!depth) {
        tell(t("Nothing is there to focus on. Click an object."));
        return;
      }
      const distance = alongSight(form.view(), asked, at, depth);
      form.focus(distance);
      setPicking(false);
      const told = t("Sharp at a distance of {distance}.", { distance: distance.toPrecision(4) });
      tell(form.view().aperture ? told : t("{told} Give the lens an aperture to see it.", { told }));
      focused = !form.view().aperture;
      refresh();
    };
    link.say({ pick: [at.x, at.y] });
  };
  const letGo = viewHand(surface, {
    view: form.view,
    turn,
    size: diagonal(scene.bounds),
    pressed(event) {
      if (picking) focusAt(event);
      return picking;
    },
    centre(event) {
      const at = pixelAt(event);
      onPicked = ({ position }) => position && turn(lookAt(form.view(), position));
      link.say({ pick: [at.x, at.y] });
    },
  });

  const look = () => {
    picture.look = { exposure: exposure.valueAsNumber, curve: curve.value };
    setText(shown, `${exposure.valueAsNumber > 0 ? "+" : ""}${exposure.valueAsNumber} EV`);
    picture.invalidate();
  };
  exposure.addEventListener("input", look);
  exposure.addEventListener("dblclick", () => ((exposure.value = "0"), look()));
  curve.addEventListener("change", look);

  let width = 0;
  const resizing = new ResizeObserver(() => {
    if (Math.abs(surface.clientWidth - width) < 2) return;
    width = surface.clientWidth;
    refresh();
  });
  resizing.observe(surface);
  refresh();
  return {
    element,
    refresh,
    dispose() {
      resizing.disconnect();
      letGo();
      link.close();
      picture.dispose();
    },
  };
}

/**
 * As many pixels as the view has on the screen, in the picture's shape.
 *
 * @param {number} width of the picture that is asked for
 * @param {number} height
 * @param {HTMLElement} surface
 */
function sizeFor(width, height, surface) {
  const wide = Math.max(LEAST_SIDE, (surface.clientWidth || 320) * Math.min(devicePixelRatio, 2));
  const scale = Math.min(wide / width, Math.sqrt(MOST_PIXELS / (width * height)));
  return { width: Math.max(1, Math.round(width * scale)), height: Math.max(1, Math.round(height * scale)) };
}

/** @param {string} frames of a shot */
function firstOf(frames) {
  const numbers = parseFrames(frames);
  return typeof numbers === "string" ? 0 : (numbers[0] ?? 0);
}

/** @param {number[][] | null} bounds */
function diagonal(bounds) {
  const [lower, upper] = bounds ?? [];
  return lower && upper ? Math.hypot(...upper.map((value, i) => value - (lower[i] ?? 0))) || 1 : 1;
}
