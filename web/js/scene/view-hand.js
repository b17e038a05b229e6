/**
 * Navigation input of a view: dragging orbits, Shift or the right button pans, the wheel dollies, two fingers do both; keys fly.
 * On a touch screen one finger scrolls the page until the view was tapped.
 */

import { aboveFloor, dolly, fly, orbit, pan } from "./orbit.js";

/** @typedef {import("../base/types.js").View} View */

/** Radians of rotation for a drag over the picture's height. */
const TURN = Math.PI;
const KEY_STEP = 0.04;
/** A wheel's notch of 100 or 120 changes the distance by a seventh. */
const DOLLY_PER_PIXEL = 0.0013;
const KEY_DOLLY = 1.1;
const TAP_PX = 8;
const TAP_MS = 400;
/** Seconds to fly through the whole scene. */
const THROUGH_S = 4;
const FASTER = 4;

/** Directions of the keys: right, up, forward. @type {Record<string, [number, number, number]>} */
const FLIGHT = { w: [0, 0, 1], s: [0, 0, -1], a: [-1, 0, 0], d: [1, 0, 0], e: [0, 1, 0], q: [0, -1, 0] };

/**
 * @param {HTMLElement} surface
 * @param {object} hand
 * @param {() => View} hand.view
 * @param {(view: View) => void} hand.turn
 * @param {(event: PointerEvent) => boolean} hand.pressed whether the press was for something else
 * @param {(event: KeyboardEvent) => boolean} hand.keyed whether the key was
 * @param {(event: MouseEvent) => void} hand.centre
 * @param {number} hand.size of the scene: its diagonal
 * @param {() => import("./orbit.js").Floor | null} hand.floor floor above which the eye stays; null: there is none
 * @returns {() => void} lets go
 */
export function viewHand(surface, { view, turn: show, pressed, keyed, centre, size, floor }) {
  const turn = (/** @type {View} */ next) => show(aboveFloor(view(), next, floor()));
  /** Pressed pointers with their latest positions. @type {Map<number, {x: number, y: number}>} */
  const down = new Map();
  let tap = { x: 0, y: 0, at: 0 };
  const isHeld = () => surface.classList.contains("held");
  const hold = (/** @type {boolean} */ on) => surface.classList.toggle("held", on);
  const elsewhere = (/** @type {PointerEvent} */ event) => {
    if (!surface.contains(/** @type {Node} */ (event.target))) hold(false);
  };
  document.addEventListener("pointerdown", elsewhere);

  surface.addEventListener("contextmenu", (event) => event.preventDefault());
  surface.addEventListener("pointerdown", (event) => {
    tap = { x: event.clientX, y: event.clientY, at: performance.now() };
    if (pressed(event)) return;
    if (event.pointerType !== "touch" || isHeld()) surface.setPointerCapture(event.pointerId);
    down.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  surface.addEventListener("pointermove", (event) => {
    const before = down.get(event.pointerId);
    if (!before) return;
    const now = { x: event.clientX, y: event.clientY };
    const height = surface.clientHeight;
    const dx = (now.x - before.x) / height;
    const dy = (now.y - before.y) / height;
    down.set(event.pointerId, now);
    if (down.size > 1) {
      const other = [...down].find(([id]) => id !== event.pointerId)?.[1] ?? now;
      const apart = (/** @type {{x: number, y: number}} */ p) => Math.max(1, Math.hypot(p.x - other.x, p.y - other.y));
      turn(dolly(pan(view(), dx / 2, dy / 2), apart(before) / apart(now)));
    } else if (event.shiftKey || event.buttons & 6) {
      turn(pan(view(), dx, dy));
    } else if (event.pointerType !== "touch" || isHeld()) {
      turn(orbit(view(), dx * TURN, dy * TURN));
    }
  });
  for (const type of /** @type {const} */ (["pointerup", "pointercancel"]))
    surface.addEventListener(type, (event) => {
      down.delete(event.pointerId);
      const isTap = Math.hypot(event.clientX - tap.x, event.clientY - tap.y) < TAP_PX && performance.now() - tap.at < TAP_MS;
      if (type === "pointerup" && isTap && event.pointerType === "touch") hold(true);
    });
  // The view handles two fingers; with one of them the browser would scroll.
  surface.addEventListener("touchmove", (event) => (event.touches.length > 1 || isHeld()) && event.preventDefault(), {
    passive: false,
  });
  surface.addEventListener("dblclick", centre);
  surface.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? event.deltaY * 16 : event.deltaY;
      turn(dolly(view(), Math.exp(pixels * DOLLY_PER_PIXEL)));
    },
    { passive: false },
  );

  /** Pressed flight keys. @type {Set<string>} */
  const flying = new Set();
  let isFast = false;
  let last = 0;
  let frame = 0;
  const glide = (/** @type {number} */ now) => {
    const way = [...flying].reduce((sum, key) => sum.map((v, i) => v + (FLIGHT[key]?.[i] ?? 0)), [0, 0, 0]);
    const far = (Math.min(now - last, 100) / 1000) * (size / THROUGH_S) * (isFast ? FASTER : 1);
    last = now;
    if (way.some(Boolean)) turn(fly(view(), (way[0] ?? 0) * far, (way[1] ?? 0) * far, (way[2] ?? 0) * far));
    frame = flying.size ? requestAnimationFrame(glide) : 0;
  };
  const land = () => flying.clear();
  surface.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (keyed(event)) {
      event.preventDefault();
      return;
    }
    const key = event.key.toLowerCase();
    if (key in FLIGHT) {
      event.preventDefault();
      flying.add(key);
      isFast = event.shiftKey;
      if (!frame) {
        last = performance.now();
        frame = requestAnimationFrame(glide);
      }
      return;
    }
    const move = event.shiftKey ? pan : orbit;
    const step = event.shiftKey ? KEY_STEP : KEY_STEP * TURN;
    /** @type {Record<string, () => View>} */
    const moves = {
      ArrowLeft: () => move(view(), -step, 0),
      ArrowRight: () => move(view(), step, 0),
      ArrowUp: () => move(view(), 0, -step),
      ArrowDown: () => move(view(), 0, step),
      "+": () => dolly(view(), 1 / KEY_DOLLY),
      "-": () => dolly(view(), KEY_DOLLY),
    };
    const made = moves[event.key]?.();
    if (!made) return;
    event.preventDefault();
    turn(made);
  });
  surface.addEventListener("keyup", (event) => {
    flying.delete(event.key.toLowerCase());
    isFast = event.shiftKey;
  });
  surface.addEventListener("blur", land);
  return () => {
    land();
    cancelAnimationFrame(frame);
    document.removeEventListener("pointerdown", elsewhere);
  };
}
