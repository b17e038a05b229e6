/** Tools for the displayed picture: fullscreen, copy, copy link. */

import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { fetchFile } from "../news/images.js";
import { announce, showError } from "../shell/tray.js";
import { t } from "../base/words.js";

/** @typedef {import("../film/film-view.js").FilmView} FilmView */
/** @typedef {import("../shell/shortcuts.js").Shortcut} Shortcut */

/** Duration of a tool's success mark. */
const DONE_MS = 1600;
const NO_CLIPBOARD = t("Browsers copy from pages on HTTPS and localhost only.");

/** The word on a tool's button, shown where there is room. @param {string} word */
export const toolWord = (word) => h("span", { class: "tool-word", "aria-hidden": "true" }, word);

/**
 * @param {HTMLElement} stage
 * @param {FilmView | null} view
 * @param {() => string} image the address of the picture as it looks now, as PNG
 * @param {HTMLElement[]} more tools before these; a pressed one is active, until another is
 * @returns {{element: HTMLElement, release: () => void, keys: Shortcut[]}} release: makes no tool active
 */
export function pictureTools(stage, view, image, more = []) {
  const copyPicture = tool(t("Copy the picture"), t("Copy"), "Y", "copy", () => {
    // The promise is passed to the item, since Safari only copies what starts within the click.
    return navigator.clipboard.write([new ClipboardItem({ "image/png": fetchFile(image()) })]);
  });
  const copyLink = tool(t("Copy the link to this view"), t("Link"), "Shift+Y", "link", () => navigator.clipboard.writeText(location.href));
  const whole = tool(t("Full screen"), t("Full screen"), "W", "screen", () =>
    document.fullscreenElement ? document.exitFullscreen() : stage.requestFullscreen(),
  );
  const tools = view ? [copyPicture, copyLink, whole] : [];
  const isActive = (/** @type {HTMLElement} */ button) => button.getAttribute("aria-pressed") === "true";
  const release = (/** @type {HTMLElement | null} */ kept = null) => {
    for (const button of more) if (button !== kept && isActive(button)) button.click();
  };
  // A click on the picture is for one tool.
  for (const button of more) button.addEventListener("click", () => isActive(button) && release(button));
  return {
    element: h(
      "span",
      { class: "picture-tools", role: "toolbar", "aria-label": t("Tools") },
      more,
      tools.map(({ button }) => button),
    ),
    release,
    keys: tools.map(({ keys, does, run }) => ({ keys, does, run })),
  };
}

/**
 * @param {string} does
 * @param {string} word on the button, where there is room
 * @param {string} keys
 * @param {import("../base/icons.js").IconName} sign
 * @param {() => Promise<unknown>} work
 */
function tool(does, word, keys, sign, work) {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let showing;
  const run = async () => {
    try {
      await work();
      announce(t("{does}: done", { does }));
      button.firstElementChild?.replaceWith(icon("check"));
      clearTimeout(showing);
      showing = setTimeout(() => button.firstElementChild?.replaceWith(icon(sign)), DONE_MS);
    } catch (error) {
      showError(t("{does}: not done", { does }), navigator.clipboard ? error : NO_CLIPBOARD);
    }
  };
  const button = h("button", { class: "icon-button", type: "button", "aria-label": does, title: `${does} (${keys})`, onclick: run }, icon(sign), toolWord(word));
  return { button, keys, does, run };
}
