/** Links that save a file of the service, or show its error. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { askFor, saveFile } from "../news/images.js";
import { showActionNotice, showBriefly, showError } from "../shell/tray.js";

/** Time, in milliseconds, after which a file that waits for a worker offers another one. */
const PATIENCE_MS = 400;

/** sentence: why the file takes time. label: of the button that saves the one at `address` in its place. @typedef {{sentence: string, label: string, address: string}} Alternative */

/**
 * @param {string} text
 * @param {string} hint
 * @param {() => string} address made when it is used: exposure, channel and frame are those of that moment
 * @param {{label?: string, isLarge?: boolean, isPlain?: boolean, alternative?: () => Alternative | null}} [options] alternative: what can be saved at once while the file waits for a worker; null: it does not wait. isLarge: the browser writes the file to the disk as it arrives; isPlain: without an icon
 */
export function downloadLink(text, hint, address, { label, isLarge = false, isPlain = false, alternative = () => null } = {}) {
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
    const waiting = new AbortController();
    const other = alternative();
    const instead = (/** @type {string} */ address) => {
      waiting.abort();
      saveFile(address).then((file) => showBriefly(t("Saved: {file}", { file })), (error) => showError(t("{file}: not saved", { file: text }), error));
    };
    let withdraw = () => {};
    const offer = other && setTimeout(() => (withdraw = showActionNotice(other.sentence, { label: other.label, run: () => instead(other.address) })), PATIENCE_MS);
    try {
      if (isLarge) {
        await askFor(anchor.href);
        isAnswered = true;
        anchor.click();
        isAnswered = false;
      } else {
        const file = await saveFile(anchor.href, waiting.signal);
        showBriefly(t("Saved: {file}", { file }));
      }
    } catch (error) {
      if (!waiting.signal.aborted) showError(t("{file}: not saved", { file: text }), error);
    } finally {
      clearTimeout(offer ?? undefined);
      withdraw();
      isSaving = false;
      anchor.removeAttribute("aria-busy");
    }
  });
  aim();
  return anchor;
}
