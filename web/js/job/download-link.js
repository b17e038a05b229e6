/** Links that save a file of the service, or show its error. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { askFor, saveFile } from "../news/images.js";
import { showBriefly, showError } from "../shell/tray.js";

/**
 * @param {string} text
 * @param {string} hint
 * @param {() => string} address made when it is used: exposure, channel and frame are those of that moment
 * @param {{label?: string, isLarge?: boolean, isPlain?: boolean}} [options] isLarge: the browser writes the file to the disk as it arrives; isPlain: without an icon
 */
export function downloadLink(text, hint, address, { label, isLarge = false, isPlain = false } = {}) {
  const anchor = h("a", { class: "button", title: hint, download: "" }, !isPlain && icon("download"), text);
  if (label) anchor.setAttribute("aria-label", label);
  const aim = () => (anchor.href = address());
  for (const type of ["pointerdown", "focus"]) anchor.addEventListener(type, aim);
  let isSaving = false;
  let isAnswered = false; // the page repeats the click for the browser
  anchor.addEventListener("click", async (event) => {
    aim();
    if (isAnswered || event.ctrlKey || event.metaKey || event.shiftKey || event.altKey) return;
    event.preventDefault();
    if (isSaving) return;
    isSaving = true;
    anchor.setAttribute("aria-busy", "true");
    try {
      if (isLarge) {
        await askFor(anchor.href);
        isAnswered = true;
        anchor.click();
        isAnswered = false;
      } else showBriefly(t("Saved: {file}", { file: await saveFile(anchor.href) }));
    } catch (error) {
      showError(t("{file}: not saved", { file: text }), error);
    } finally {
      isSaving = false;
      anchor.removeAttribute("aria-busy");
    }
  });
  aim();
  return anchor;
}
