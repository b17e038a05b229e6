/** The live view's switch for denoised pictures, which are the default where workers can denoise. */

import { canDenoise } from "../job/denoise-fields.js";
import { workers } from "../news/farm.js";
import { h } from "../base/dom.js";
import { t } from "../base/words.js";

const KEY = "rayfarm-view-denoise";

/**
 * @param {() => void} changed
 * @returns {{element: HTMLButtonElement, isOn: () => boolean, request: () => {denoise: boolean}, dispose: () => void}} isOn: whether workers denoise the
 *   view. request: the field of a view's request
 */
export function denoiseView(changed) {
  let isOn = isViewDenoised();
  const element = h(
    "button",
    { class: "button small", type: "button", hidden: true, title: t("Show the view without most of its noise"), onclick: () => turn(!isOn) },
    t("Denoise"),
  );
  const show = () => element.setAttribute("aria-pressed", String(isOn));
  /** @param {boolean} on */
  const turn = (on) => {
    isOn = on;
    try {
      localStorage.setItem(KEY, on ? "on" : "off");
    } catch {
      // Storage is blocked: the choice lasts until the page is closed.
    }
    show();
    changed();
  };
  show();
  const end = workers.subscribe((all) => (element.hidden = !canDenoise(all)));
  return { element, isOn: () => isOn && canDenoise(workers.value), request: () => ({ denoise: isOn }), dispose: end };
}

/** Whether the live view is denoised where workers can, which the browser remembers. */
export function isViewDenoised() {
  try {
    return localStorage.getItem(KEY) !== "off";
  } catch {
    return true;
  }
}
