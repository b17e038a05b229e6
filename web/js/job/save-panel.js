/** Downloads: the picture as displayed, or its light; raw and denoised. */

import { imageUrl } from "../news/api.js";
import { h, setText } from "../base/dom.js";
import { t } from "../base/words.js";
import { downloadLink } from "./download-link.js";

/** @typedef {import("../base/store.js").Store<import("./display-panel.js").Display>} DisplayStore */

const FORMATS = /** @type {const} */ ([
  ["png", t("As it looks now, exposure and tone curve included")],
  ["exr", t("Scene-linear floats, untouched by exposure and curve")],
  ["jpg", t("As it looks now, small")],
]);

/**
 * @param {DisplayStore} display
 * @param {() => import("../news/api.js").Place} place which of its pictures
 * @returns {{element: HTMLElement, offerDenoised: (can: boolean) => void}}
 */
export function savePanel(display, place) {
  const raw = row(
    "",
    FORMATS.map(([format, hint]) => link(display, place, format, hint, false)),
  );
  const clean = row(
    t("Denoised"),
    FORMATS.map(([format, hint]) => link(display, place, format, hint, true)),
  );
  let can = false;
  const show = () => {
    // With a denoiser these keep their space for planes that are not denoised, so that nothing below moves.
    const shown = display.value.channel === "" ? "" : "hidden";
    setText(raw.label, t("As rendered"));
    for (const part of [raw.label, clean.element]) {
      part.hidden = !can;
      part.style.visibility = shown;
    }
  };
  display.subscribe(show);
  return {
    element: h(
      "section",
      { class: "side-section stack tight", "aria-label": t("Save") },
      h("h2", null, t("Save")),
      raw.element,
      clean.element,
    ),
    offerDenoised(now) {
      can = now;
      show();
    },
  };
}

/**
 * URL of the picture as displayed.
 *
 * @param {import("../news/api.js").Place} place
 * @param {import("./display-panel.js").Display} look
 */
export function asItLooks(place, { exposure, curve, channel, denoise }) {
  if (channel) return imageUrl(place, "png", { aov: channel });
  return imageUrl(place, "png", { exposure, tonemap: curve, ...(denoise === "on" && { denoise: "true" }) });
}

/** @param {string} text @param {HTMLElement[]} links */
export function row(text, links) {
  const label = h("span", { class: "quiet small" }, text);
  return { label, element: h("div", { class: "stack tight" }, label, h("div", { class: "triple" }, links)) };
}

/**
 * @param {DisplayStore} display
 * @param {() => import("../news/api.js").Place} place
 * @param {"png" | "exr" | "jpg"} format
 * @param {string} hint
 * @param {boolean} denoise
 */
function link(display, place, format, hint, denoise) {
  const name = format.toUpperCase();
  const address = () => {
    const { exposure, curve, channel } = display.value;
    /** @type {Record<string, string | number>} */
    const query = channel ? { aov: channel } : format === "exr" ? {} : { exposure, tonemap: curve };
    if (denoise) query.denoise = "true";
    return imageUrl(place(), format, query);
  };
  return downloadLink(name, hint, address, { label: name + (denoise ? t(", denoised") : "") });
}
