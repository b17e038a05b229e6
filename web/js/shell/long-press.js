/** Shows a card's own actions after a long press, where no mouse can hover over it. */

/** Duration of a long press, and the movement that ends one, in CSS pixels. */
const [PRESS_MS, MOST_MOVE] = [500, 10];

/**
 * Marks an element as held after a long press, until another place is touched. The press does not open the element's link.
 *
 * @param {HTMLElement} element
 */
export function holdOnLongPress(element) {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let pressing;
  let [x, y] = [0, 0];
  const end = () => clearTimeout(pressing);
  const keepClosed = (/** @type {Event} */ event) => event.preventDefault();
  const release = (/** @type {PointerEvent} */ { target }) => {
    element.removeEventListener("click", keepClosed, true);
    if (target instanceof Node && element.contains(target)) return;
    element.classList.remove("held");
    removeEventListener("pointerdown", release, true);
  };
  const hold = () => {
    element.classList.add("held");
    element.addEventListener("click", keepClosed, true); // which ends this press
    addEventListener("pointerdown", release, true);
  };
  element.addEventListener("pointerdown", (event) => {
    end();
    if (event.pointerType !== "touch" || element.classList.contains("held")) return;
    [x, y] = [event.clientX, event.clientY];
    pressing = setTimeout(hold, PRESS_MS);
  });
  element.addEventListener("pointermove", (event) => Math.hypot(event.clientX - x, event.clientY - y) > MOST_MOVE && end());
  for (const type of ["pointerup", "pointercancel", "pointerleave"]) element.addEventListener(type, end);
  element.addEventListener("contextmenu", (event) => /** @type {PointerEvent} */ (event).pointerType === "touch" && event.preventDefault()); // the link's own menu
}
