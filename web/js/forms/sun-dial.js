/**
 * The sun's position on the hemisphere seen from above: the centre is the zenith, the rim the horizon. Up is -Z, away from a
 * viewer in front of the scene; right is +X.
 */

import { h } from "../base/dom.js";
import { t } from "../base/words.js";

const SVG = "http://www.w3.org/2000/svg";
const RADIUS = 44;

/**
 * @param {string} tag
 * @param {Record<string, string | number>} attributes
 * @param {...Node} children
 */
function svg(tag, attributes, ...children) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  element.append(...children);
  return element;
}

/**
 * @param {{elevation: number, azimuth: number}} sun degrees
 * @returns {[number, number]} position on the dial; its centre is 0, 0
 */
function placeOf({ elevation, azimuth }) {
  const away = (RADIUS * (90 - Math.max(0, Math.min(90, elevation)))) / 90;
  const around = (azimuth * Math.PI) / 180;
  return [away * Math.sin(around), -away * Math.cos(around)];
}

/**
 * @param {number} x
 * @param {number} y
 * @returns {{elevation: number, azimuth: number}} whole degrees
 */
function sunAt(x, y) {
  const away = Math.min(Math.hypot(x, y) / RADIUS, 1);
  const around = Math.round((Math.atan2(x, -y) * 180) / Math.PI);
  return { elevation: Math.round(90 * (1 - away)), azimuth: (around + 360) % 360 };
}

/**
 * @param {(sun: {elevation: number, azimuth: number}, isDone: boolean) => void} changed by the user; done: let go of
 * @returns {{element: HTMLElement, set: (sun: {elevation: number, azimuth: number}) => void}}
 */
export function sunDial(changed) {
  let sun = { elevation: 35, azimuth: 0 };
  const disk = svg("circle", { r: 5, class: "sun" });
  const ray = svg("line", { x1: 0, y1: 0, class: "ray" });
  const face = svg(
    "svg",
    { viewBox: "-54 -54 108 108", "aria-hidden": "true" },
    svg("circle", { r: RADIUS, class: "sky" }),
    ...[30, 60].map((degrees) => svg("circle", { r: (RADIUS * (90 - degrees)) / 90, class: "ring" })),
    svg("path", { d: `M0 ${-RADIUS}V${RADIUS}M${-RADIUS} 0H${RADIUS}`, class: "ring" }),
    svg("rect", { x: -5, y: -5, width: 10, height: 10, rx: 1.5, class: "subject" }),
    svg("path", { d: "M-4 53L0 48L4 53Z", class: "viewer" }),
    ray,
    disk,
  );
  const element = h("div", {
    class: "sun-dial",
    role: "slider",
    tabindex: "0",
    "aria-label": t("Sun position: up and down change its elevation, left and right its direction"),
    "aria-valuemin": "0",
    "aria-valuemax": "90",
    title: t("Drag the sun: the centre is overhead, the rim the horizon, the bottom the front of the scene"),
  });
  element.append(face);
  const show = () => {
    const [x, y] = placeOf(sun);
    for (const [name, value] of [["cx", x], ["cy", y]]) disk.setAttribute(String(name), String(value));
    for (const [name, value] of [["x2", x], ["y2", y]]) ray.setAttribute(String(name), String(value));
    element.setAttribute("aria-valuenow", String(sun.elevation));
    element.setAttribute("aria-valuetext", t("{elevation}° high, direction {azimuth}°", sun));
  };
  /** @param {{elevation: number, azimuth: number}} next @param {boolean} isDone */
  const move = (next, isDone) => {
    sun = next;
    show();
    changed(sun, isDone);
  };
  /** @param {PointerEvent} event */
  const under = ({ clientX, clientY }) => {
    const box = face.getBoundingClientRect();
    const scale = 108 / box.width;
    return sunAt((clientX - box.left - box.width / 2) * scale, (clientY - box.top - box.height / 2) * scale);
  };
  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    move(under(event), false);
  });
  element.addEventListener("pointermove", (event) => element.hasPointerCapture(event.pointerId) && move(under(event), false));
  element.addEventListener("pointerup", () => changed(sun, true));
  element.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? 10 : 1;
    const by = { ArrowUp: [step, 0], ArrowDown: [-step, 0], ArrowLeft: [0, -step], ArrowRight: [0, step] }[event.key];
    if (!by) return;
    event.preventDefault();
    const [up = 0, around = 0] = by;
    const elevation = Math.max(0, Math.min(90, sun.elevation + up));
    move({ elevation, azimuth: (((sun.azimuth + around) % 360) + 360) % 360 }, true);
  });
  show();
  return {
    element,
    set(next) {
      sun = next;
      show();
    },
  };
}
