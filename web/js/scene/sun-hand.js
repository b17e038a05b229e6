/** The sun tool: a click puts the sun into the sky there, or such that its highlight is on the clicked surface. */

import { DAY } from "../forms/environment-fields.js";
import { sunFor } from "./light-math.js";
import { t } from "../base/words.js";

/** @typedef {import("../forms/environment-fields.js").LightHandle} LightHandle */
/** @typedef {import("./view-link.js").Picked} Picked */

/**
 * @param {HTMLElement} surface
 * @param {LightHandle} light
 * @param {(event: MouseEvent, then: (picked: Picked) => void) => void} pick requests the surface under the pointer
 * @param {(sentence: string) => void} tell
 * @returns {import("./view-tools.js").Tool}
 */
export function sunHand(surface, light, pick, tell) {
  /** @type {{undo: () => void, end: () => void, isDown: boolean} | null} */
  let drag = null;
  /** The pending request. @type {object | null} */
  let asked = null;
  /** The pointer's latest position since that request. @type {PointerEvent | null} */
  let next = null;
  /** @param {Picked} picked */
  const place = (picked) => {
    if (!picked.direction) return;
    const sun = sunFor({ direction: picked.direction, normal: picked.normal });
    light.stand(sun, true);
    const at = { elevation: `${Math.round(sun.elevation)}°`, azimuth: `${Math.round(sun.azimuth) % 360}°` };
    const told = t("Sun at {elevation} elevation, {azimuth}.", at);
    if (!sun.isRaised) tell(told);
    else if (picked.normal) tell(t("{told} A highlight there needs a sun below the horizon, so it is placed just above it.", { told }));
    else tell(t("{told} That is below the horizon, so it is placed just above it.", { told }));
  };
  /** @param {PointerEvent} event */
  const ask = (event) => {
    next = null;
    const question = (asked = {});
    pick(event, (picked) => {
      if (question !== asked || !drag) return; // cancelled, or pressed again
      asked = null;
      place(picked);
      if (next) ask(next);
      else if (!drag.isDown) drag = null;
    });
  };
  return {
    name: "sun",
    icon: "sun",
    label: t("Place the sun"),
    short: t("Sun"),
    title: t("Place the sun: click the sky, or what it is to light"),
    hint: t("Click or drag: in the sky the sun stands there, on a surface its highlight does. Escape ends."),
    press(event) {
      drag?.end();
      surface.setPointerCapture(event.pointerId);
      const ending = new AbortController();
      const on = { signal: ending.signal };
      const own = (/** @type {PointerEvent} */ { pointerId }) => pointerId === event.pointerId;
      drag = { undo: light.keep(), end: () => ending.abort(), isDown: true };
      surface.addEventListener("pointermove", (now) => {
        if (!own(now)) return;
        if (asked) next = now;
        else ask(now);
      }, on);
      for (const kind of /** @type {const} */ (["pointerup", "pointercancel"]))
        surface.addEventListener(kind, (now) => {
          if (!own(now)) return;
          ending.abort();
          if (!drag) return;
          drag.isDown = false;
          if (!asked) drag = null;
        }, on);
      ask(event);
    },
    key(event) {
      const step = event.shiftKey ? 10 : 1;
      const by = { ArrowUp: [step, 0], ArrowDown: [-step, 0], ArrowLeft: [0, -step], ArrowRight: [0, step] }[event.key];
      if (!by || event.ctrlKey || event.metaKey || event.altKey) return false;
      const { elevation, azimuth } = light.sun() ?? DAY;
      place({ ...{ x: 0, y: 0, depth: null, position: null, normal: null }, direction: towards(elevation + (by[0] ?? 0), azimuth + (by[1] ?? 0)) });
      return true;
    },
    takeBack() {
      if (!drag) return false;
      drag.end();
      drag.undo();
      drag = next = asked = null;
      tell(t("Undone."));
      return true;
    },
  };
}

/** @param {number} elevation degrees @param {number} azimuth @returns {import("../base/types.js").Vec3} */
function towards(elevation, azimuth) {
  const [high, around] = [Math.min(Math.max(elevation, 0), 89.999), azimuth].map((degrees) => (degrees * Math.PI) / 180);
  const level = Math.cos(high ?? 0);
  return [level * Math.sin(around ?? 0), Math.sin(high ?? 0), -level * Math.cos(around ?? 0)];
}
