/**
 * The light tool: dragging sideways across the view rotates the light, dragging vertically changes its strength; the arrow keys
 * do the same. Holding its key activates it temporarily, pressing the key toggles it.
 */

import { h, setText } from "../base/dom.js";
import { brighter, dragged, halfTurn } from "./light-math.js";
import { t } from "../base/words.js";

/** @typedef {import("../forms/environment-fields.js").LightHandle} LightHandle */

/** Degrees, and stops, per press of an arrow key; `long` with Shift. */
const TURN = { step: 5, long: 15 };
const STOPS = { step: 1 / 8, long: 1 / 2 };
/** Minimum duration of a press that counts as holding. */
const HELD_MS = 400;
const READ_MS = 1500;

/**
 * @param {HTMLElement} surface that takes the pointer
 * @param {() => HTMLElement} seen where the picture is, within it
 * @param {LightHandle} light
 * @returns {{tool: import("./view-tools.js").Tool, readout: HTMLElement, dispose: () => void}} readout: what it is now, over the view
 */
export function lightHand(surface, seen, light) {
  const readout = h("div", { class: "view-readout number", role: "status", hidden: true });
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  /** @param {string} sentence */
  const show = (sentence) => {
    setText(readout, sentence);
    readout.hidden = false;
    clearTimeout(timer);
    if (!drag) timer = setTimeout(() => (readout.hidden = true), READ_MS);
  };
  const words = () => {
    const { rotation, strength, turns } = light.get();
    const shown = { rotation: Number(rotation.toFixed(1)), strength };
    return turns ? t("Rotation {rotation}°, strength {strength}", shown) : t("Strength {strength}; one colour has no direction", shown);
  };
  /** @type {{x: number, y: number, before: ReturnType<LightHandle["get"]>, undo: () => void, end: () => void} | null} */
  let drag = null;
  const letGo = () => {
    drag?.end();
    drag = null;
  };
  /** @param {PointerEvent} event */
  const press = (event) => {
    letGo();
    surface.setPointerCapture(event.pointerId);
    const ending = new AbortController();
    const on = { signal: ending.signal };
    drag = { x: event.clientX, y: event.clientY, before: light.get(), undo: light.keep(), end: () => ending.abort() };
    show(words());
    const own = (/** @type {PointerEvent} */ { pointerId }) => pointerId === event.pointerId;
    surface.addEventListener("pointermove", (now) => {
      if (!drag || !own(now)) return;
      const moved = { across: now.clientX - drag.x, up: drag.y - now.clientY };
      const { width, height } = seen().getBoundingClientRect();
      const next = dragged(drag.before, moved, { width, height });
      light.set(drag.before.turns ? next : { ...next, rotation: drag.before.rotation }, false);
      show(words());
    }, on);
    surface.addEventListener("pointerup", (now) => {
      if (!own(now)) return;
      letGo();
      light.set(light.get(), true);
      show(words());
    }, on);
    surface.addEventListener("pointercancel", (now) => void (own(now) && takeBack()), on);
  };
  const takeBack = () => {
    if (!drag) return false;
    const { undo } = drag;
    letGo();
    undo();
    show(t("Undone: {words}", { words: words() }));
    return true;
  };
  /** @param {KeyboardEvent} event */
  const key = (event) => {
    const [turn, stops] = event.shiftKey ? [TURN.long, STOPS.long] : [TURN.step, STOPS.step];
    const step = { ArrowLeft: [turn, 0], ArrowRight: [-turn, 0], ArrowUp: [0, stops], ArrowDown: [0, -stops] }[event.key];
    if (!step || event.ctrlKey || event.metaKey || event.altKey) return false;
    const [around = 0, up = 0] = step;
    const { rotation, strength, turns } = light.get();
    light.set({ rotation: turns ? halfTurn(rotation + around) : rotation, strength: up ? brighter(strength, up) : strength }, true);
    show(words());
    return true;
  };
  return {
    tool: {
      name: "light",
      icon: "turn",
      label: t("Turn the light"),
      short: t("Light"),
      title: t("Turn the light: hold L and drag, or Shift and the right button"),
      hint: t("Drag sideways to turn the light, up or down to change its strength, or use the arrow keys. Escape undoes it."),
      press,
      key,
      takeBack,
    },
    readout,
    dispose: () => (clearTimeout(timer), letGo()),
  };
}

/**
 * The key that activates a tool, while held or until pressed again.
 *
 * @param {string} letter in lower case
 * @param {() => boolean} isOn
 * @param {(on: boolean) => void} choose
 * @returns {{down: () => void, dispose: () => void}} down: it is pressed, or repeats
 */
export function heldKey(letter, isOn, choose) {
  /** Time of the key press, while the key is down. @type {{at: number, wasOn: boolean, isUsed: boolean} | null} */
  let held = null;
  const used = () => held && (held.isUsed = true);
  const up = (/** @type {KeyboardEvent} */ { key }) => {
    if (!held || key.toLowerCase() !== letter) return;
    const { at, wasOn, isUsed } = held;
    held = null;
    if (wasOn || isUsed || performance.now() - at > HELD_MS) choose(false);
  };
  const forget = () => void (held = null);
  addEventListener("keyup", up);
  addEventListener("pointerdown", used, true);
  addEventListener("blur", forget);
  return {
    down() {
      if (held) return;
      held = { at: performance.now(), wasOn: isOn(), isUsed: false };
      choose(true);
    },
    dispose() {
      removeEventListener("keyup", up);
      removeEventListener("pointerdown", used, true);
      removeEventListener("blur", forget);
    },
  };
}
