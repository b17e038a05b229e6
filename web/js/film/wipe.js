/** The divider between two pictures, moved by mouse, finger or keys. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

const STEP = 0.01;
const LONG_STEP = 0.1;

/**
 * @param {(fraction: number) => void} moved of the stage's width, from the left
 * @returns {{element: HTMLElement, set: (fraction: number, left: string, right: string) => void}}
 */
export function wipeDivider(moved) {
  let at = 0.5;
  const element = h(
    "div",
    {
      class: "wipe",
      role: "slider",
      tabindex: "0",
      "aria-label": t("Wipe between the pictures"),
      "aria-orientation": "horizontal",
      "aria-valuemin": "0",
      "aria-valuemax": "100",
    },
    h("span", { class: "grip" }, icon("wipe")),
  );
  /** @param {number} fraction */
  const move = (fraction) => moved(Math.min(Math.max(fraction, 0), 1));

  element.addEventListener("pointerdown", (event) => {
    event.stopPropagation(); // otherwise the stage below pans
    element.setPointerCapture(event.pointerId);
    element.focus({ preventScroll: true });
  });
  element.addEventListener("pointermove", (event) => {
    if (!element.hasPointerCapture(event.pointerId)) return;
    event.stopPropagation();
    const box = /** @type {Element} */ (element.parentElement).getBoundingClientRect();
    move((event.clientX - box.left) / box.width);
  });
  element.addEventListener("dblclick", (event) => {
    event.stopPropagation();
    move(0.5);
  });
  element.addEventListener("keydown", (event) => {
    const step = event.shiftKey ? LONG_STEP : STEP;
    /** @type {Record<string, number>} */
    const places = {
      ArrowLeft: at - step,
      ArrowDown: at - step,
      ArrowRight: at + step,
      ArrowUp: at + step,
      Home: 0,
      End: 1,
    };
    const to = places[event.key];
    if (to === undefined || event.ctrlKey || event.metaKey || event.altKey) return;
    event.preventDefault(); // otherwise the render view moves its pixel cursor
    move(Math.round(to / STEP) * STEP);
  });
  return {
    element,
    set(fraction, left, right) {
      at = fraction;
      const percent = Math.round(fraction * 100);
      element.style.left = `${fraction * 100}%`;
      element.setAttribute("aria-valuenow", String(percent));
      element.setAttribute("aria-valuetext", `${percent} % ${left}, ${100 - percent} % ${right}`);
    },
  };
}
