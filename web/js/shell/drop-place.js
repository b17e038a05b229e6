/** Where files were dropped or chosen, so that a refusal is shown there. */

/** In CSS pixels of the window. @typedef {{x: number, y: number}} Place */

/** @type {Place | null} */
let latest = null;

/** @param {Place} place */
export const setDropPlace = (place) => (latest = place);

/** Remembers the lower edge of the button that opens a file dialog; "Choose other files" of a refusal keeps the place. */
export function setChoicePlace() {
  const button = document.activeElement;
  if (!(button instanceof HTMLButtonElement)) return;
  const { left, width, bottom } = button.getBoundingClientRect();
  latest = { x: left + width / 2, y: bottom };
}

/** Moves an element there, whole within the window and below the point. @param {HTMLElement} element of fixed position */
export function moveToDropPlace(element) {
  if (!latest) return;
  const { offsetWidth: width, offsetHeight: height } = element;
  const clamp = (/** @type {number} */ value, /** @type {number} */ low, /** @type {number} */ high) => Math.max(low, Math.min(value, high));
  element.style.left = `${clamp(latest.x - width / 2, EDGE, innerWidth - width - EDGE)}px`;
  element.style.top = `${clamp(latest.y + EDGE, BAR + EDGE, innerHeight - height - EDGE)}px`;
}

/** Distance from the edges, and height of the top bar. */
const [EDGE, BAR] = [12, 52];
