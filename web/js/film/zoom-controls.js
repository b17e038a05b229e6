/** Zoom controls in the status bar: zoom out, scale, zoom in, fit. */

import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/** @typedef {import("./film-view.js").FilmView} FilmView */

/**
 * @param {() => FilmView | null} view
 * @returns {{element: HTMLElement, show: (scale: number) => void}}
 */
export function zoomControls(view) {
  const label = h("span", { class: "mono" });
  /**
   * @param {string} name
   * @param {import("../base/dom.js").Child} face
   * @param {() => void} run
   * @param {string} [more] class
   */
  const button = (name, face, run, more = "") =>
    h("button", { class: `icon-button ${more}`, type: "button", "aria-label": name, title: name, onclick: run }, face);
  const actual = h(
    "button",
    {
      class: "icon-button zoom-button",
      type: "button",
      title: t("Zoom; click for 1:1 (1)"),
      onclick: () => view()?.actualSize(),
    },
    label,
  );
  return {
    element: h(
      "span",
      { class: "zoom-controls" },
      button(t("Zoom out (−)"), "−", () => view()?.zoom(-1), "zoom-out"),
      actual,
      button(t("Zoom in (+)"), "+", () => view()?.zoom(1), "zoom-in"),
      button(t("Fit the picture (F)"), icon("fit"), () => view()?.fit()),
    ),
    show(scale) {
      const percent = scale * 100;
      setText(label, `${percent >= 10 ? Math.round(percent) : percent.toFixed(1)} %`);
    },
  };
}
