/** Downloads: the picture as displayed, or its light; raw and denoised. */

import { deepUrl, imageUrl } from "../news/api.js";
import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { freshId } from "../forms/fields.js";
import { lightGroupOf } from "../film/channels.js";
import { mixQuery } from "../film/light-mix.js";
import { t } from "../base/words.js";
import { secondsText } from "./finishing.js";
import { whyNotDenoised } from "./denoise-fields.js";
import { downloadLink } from "./download-link.js";

/** @typedef {import("../base/store.js").Store<import("./display-panel.js").Display>} DisplayStore */

const FORMATS = /** @type {const} */ ([
  ["png", t("As displayed, with exposure and tone curve")],
  ["exr", t("Scene-linear floats, untouched by exposure and curve")],
  ["avif", t("High dynamic range, for HDR displays; exposure included, without the tone curve")],
  ["jxl", t("JPEG XL: as AVIF, with 16 bits per channel")],
  ["jpg", t("As displayed, small")],
]);

/**
 * @param {DisplayStore} display
 * @param {() => import("../news/api.js").Place} place which of its pictures
 * @param {boolean} hasDeep whether it has deep samples
 * @param {() => number | null} left seconds until the denoised picture is expected; null: nothing is being denoised
 * @returns {{element: HTMLElement, split: HTMLElement, offer: (job: Pick<import("../base/types.js").Job, "samples" | "state">) => void, offerDenoised: (can: boolean) => void, preferDenoised: () => void, actions: import("../shell/shortcuts.js").Shortcut[]}}
 *     split: a button that saves a PNG, and an arrow that opens the other formats; offer: enables it once there are samples. actions: for the command palette
 */
export function savePanel(display, place, hasDeep, left) {
  const clean = h("input", { type: "checkbox", role: "switch", checked: display.value.denoise !== "off", onchange: () => show() });
  const denoised = h("label", { class: "check" }, clean, t("Denoised"));
  const wide = h("input", { type: "checkbox", role: "switch" });
  const hdr = h("label", { class: "check", title: t("JPG with a gain map (Ultra HDR): brighter highlights on HDR displays, the same picture on others") }, wide, t("HDR in JPG"));
  const canBeClean = () => whyNotDenoised(display.value) === "";
  const isClean = () => !denoised.hidden && clean.checked && canBeClean();
  const png = () => links[0]?.element.click();
  const links = FORMATS.map(([format, hint]) => ({ format, element: link(display, place, format, hint, { isClean, isWide: () => wide.checked, left }) }));
  const show = () => {
    const { channel } = display.value;
    clean.disabled = !canBeClean();
    denoised.title = whyNotDenoised(display.value);
    const isPlane = channel !== "" && lightGroupOf(channel) === null; // planes have no high range
    wide.disabled = isPlane;
    for (const { format, element } of links) {
      element.hidden = isPlane && HIGH_RANGE.includes(format);
      element.setAttribute("aria-label", format.toUpperCase() + (isClean() ? t(", denoised") : ""));
    }
  };
  const deep = hasDeep && downloadLink(t("Deep EXR"), t("Samples in depth with colour and alpha, for deep compositing"), () => deepUrl(place()), { isLarge: true });
  denoised.hidden = true;
  display.subscribe(show);
  const saves = links.map(({ format, element }) => ({ format, element, run: () => element.click() }));
  const split = splitButton(png, saves);
  return {
    element: h(
      "section",
      { class: "side-section stack tight", "aria-label": t("Save") },
      h("h2", null, t("Save")),
      h("div", { class: "split" }, links.map(({ element }) => element)),
      h("p", { class: "quiet small" }, t("PNG and JPG as the picture looks here, EXR for compositing, AVIF and JPEG XL for HDR displays.")),
      h("div", { class: "row wraps" }, denoised, hdr),
      deep,
    ),
    split: split.element,
    offer: split.offer,
    offerDenoised(now) {
      denoised.hidden = !now;
      show();
    },
    preferDenoised() {
      clean.checked = true;
      show();
    },
    actions: links.map(({ format, element }) => ({ keys: "", does: t("Save {format}", { format: format.toUpperCase() }), run: () => element.click() })),
  };
}

/** Formats of a high dynamic range, which planes do not have. */
const HIGH_RANGE = ["avif", "jxl"];

/**
 * @param {() => void} save as a PNG
 * @param {{format: string, element: HTMLElement, run: () => void}[]} saves of all formats; element: hidden where the format is not offered
 * @returns {{element: HTMLElement, offer: (job: Pick<import("../base/types.js").Job, "samples" | "state">) => void}} offer: enables it once there are samples
 */
function splitButton(save, saves) {
  const menu = h("div", { class: "save-menu", popover: "auto", role: "menu", "aria-label": t("Save as"), id: freshId("save-menu") });
  const main = h("button", { class: "button primary wide-word save-picture", type: "button", title: t("Save as PNG"), onclick: save }, icon("download"), h("span", null, t("Save")));
  const arrow = h("button", { class: "button primary save-formats", type: "button", title: t("Other formats"), "aria-label": t("Other formats"), "aria-haspopup": "menu", popovertarget: menu.id }, icon("down"));
  menu.addEventListener("beforetoggle", (event) => {
    if (/** @type {ToggleEvent} */ (event).newState !== "open") return;
    const { bottom, right } = arrow.getBoundingClientRect();
    menu.style.top = `${bottom}px`;
    menu.style.right = `${document.documentElement.clientWidth - right}px`;
    fill(
      menu,
      saves
        .filter(({ element }) => !element.hidden)
        .map(({ format, element, run }) => h("button", { class: "menu-item", type: "button", role: "menuitem", title: element.title, onclick: () => (menu.hidePopover(), run()) }, format.toUpperCase())),
    );
  });
  menu.addEventListener("toggle", () => /** @type {HTMLElement | null} */ (menu.firstElementChild)?.focus());
  menu.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (!step) return;
    event.preventDefault();
    event.stopPropagation();
    const items = /** @type {HTMLElement[]} */ ([...menu.children]);
    items[(items.indexOf(/** @type {HTMLElement} */ (document.activeElement)) + step + items.length) % items.length]?.focus();
  });
  const element = h("div", { class: "save-split", role: "group", "aria-label": t("Save") }, main, arrow, menu);
  const offer = (/** @type {Pick<import("../base/types.js").Job, "samples" | "state">} */ { samples, state }) => {
    for (const button of [main, arrow]) {
      button.disabled = samples === 0;
      button.classList.toggle("primary", state === "finished"); // what most want next
    }
  };
  return { element, offer };
}

/**
 * URL of the picture as displayed.
 *
 * @param {import("../news/api.js").Place} place
 * @param {import("./display-panel.js").Display} look
 */
export function asItLooks(place, look) {
  return imageUrl(place, "png", look.channel ? { aov: look.channel } : lookQuery(look));
}

/**
 * Parameters of the colour as displayed.
 *
 * @param {import("./display-panel.js").Display} look
 * @returns {Record<string, string | number>}
 */
export const lookQuery = ({ exposure, curve, denoise, mix }) => ({ exposure, tonemap: curve, ...(denoise === "on" && { denoise: "true" }), ...mixQuery(mix) });

/** @param {string} text @param {HTMLElement[]} links */
export function row(text, links) {
  const label = h("span", { class: "quiet small" }, text);
  return { label, element: h("div", { class: "stack tight" }, label, h("div", { class: "triple" }, links)) };
}

/**
 * @param {DisplayStore} display
 * @param {() => import("../news/api.js").Place} place
 * @param {"png" | "exr" | "avif" | "jxl" | "jpg"} format
 * @param {string} hint
 * @param {{isClean: () => boolean, isWide: () => boolean, left: () => number | null}} choices isClean: the denoised picture is saved; isWide: a JPG gets a gain map; left: seconds until the denoised one is expected
 */
function link(display, place, format, hint, { isClean, isWide, left }) {
  const address = (clean = isClean()) => {
    const { exposure, curve, channel, mix } = display.value;
    /** @type {Record<string, string | number>} */
    const query = { ...(channel ? { aov: channel } : mixQuery(mix)) };
    if (HIGH_RANGE.includes(format) || (!channel && format !== "exr")) query.exposure = exposure;
    if (!channel && (format === "png" || format === "jpg")) query.tonemap = curve;
    if (format === "jpg" && isWide() && (!channel || lightGroupOf(channel) !== null)) query.gain_map = "true";
    if (clean) query.denoise = "true";
    return imageUrl(place(), format, query);
  };
  const alternative = () => {
    const seconds = isClean() ? left() : null;
    if (seconds === null) return null;
    const sentence = t("{file}: the picture is being denoised, {time}.", { file: format.toUpperCase(), time: secondsText(seconds) });
    return { sentence, label: t("Save without denoising"), address: address(false) };
  };
  return downloadLink(format.toUpperCase(), hint, () => address(), { isPlain: true, alternative });
}
