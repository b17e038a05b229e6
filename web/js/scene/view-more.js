/** The less used controls of the view: in its bar, or where that is narrow, above it behind a button "More". css/view-tools.css says where. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/**
 * @param {HTMLElement} around a press in it, outside of the controls, hides them
 * @param {...HTMLElement} controls
 * @returns {HTMLElement[]} the button, and the controls
 */
export function viewMore(around, ...controls) {
  const button = h(
    "button",
    { class: "button small view-more", type: "button", "aria-expanded": "false", "aria-controls": "view-rest", "aria-label": t("More"), title: t("More"), onclick: () => show(!isOpen()) },
    icon("more"),
  );
  const rest = h("div", { class: "view-rest", id: "view-rest" }, controls);
  const isOpen = () => button.getAttribute("aria-expanded") === "true";
  const show = (/** @type {boolean} */ on) => button.setAttribute("aria-expanded", String(on));
  const isOutside = (/** @type {EventTarget | null} */ target) => target instanceof Node && !button.contains(target) && !rest.contains(target);
  for (const part of /** @type {HTMLElement[]} */ ([button, rest])) {
    part.addEventListener("focusout", (/** @type {FocusEvent} */ { relatedTarget }) => isOutside(relatedTarget) && show(false));
    part.addEventListener("keydown", (/** @type {KeyboardEvent} */ event) => {
      if (event.key !== "Escape" || !isOpen()) return;
      event.preventDefault();
      event.stopPropagation(); // Escape has a page-wide meaning too
      show(false);
      button.focus();
    });
  }
  around.addEventListener("pointerdown", ({ target }) => isOutside(target) && show(false), true);
  return [button, rest];
}
