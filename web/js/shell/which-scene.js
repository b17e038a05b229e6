/** The question which of several models in a drop is the scene, or whether each is one. */

import { h } from "../base/dom.js";
import { t } from "../base/words.js";

/** @typedef {import("./gather-files.js").NamedFile} NamedFile */

/** Formats without external files, which need nothing else of the drop. */
const WHOLE = /\.(glb|stl|ply|off)$/i;
/** Frame number in the name of a file of a sequence: smoke.0001.obj. */
const NUMBER = /\d{3,}(?=\.[a-z]+$)/i;

/**
 * Returns the files that may be the scene, best first; a single one if it is unambiguous.
 *
 * @param {NamedFile[]} files
 * @param {string[]} formats suffixes of scenes, best first, and of archives
 * @returns {string[]}
 */
export function rivals(files, formats) {
  const paths = files.map(({ path }) => path);
  for (const suffix of formats.filter((each) => each !== ".zip")) {
    const found = paths.filter((path) => path.toLowerCase().endsWith(suffix));
    const stems = new Set(found.map((path) => path.replace(NUMBER, "#")));
    if (found.length) return stems.size === 1 ? found.slice(0, 1) : found;
  }
  return paths.slice(0, 1);
}

/** @param {NamedFile[]} files @param {string} main @returns {NamedFile[]} the files that it needs, judging by its name */
export const filesFor = (files, main) => (WHOLE.test(main) ? files.filter(({ path }) => path === main) : files);

/**
 * Asks the user which model is the scene.
 *
 * @param {string[]} mains
 * @returns {Promise<string[]>} one, all of them, or none: it was dismissed
 */
export function whichScene(mains) {
  return new Promise((resolve) => {
    /** @param {string[]} chosen */
    const close = (chosen) => {
      resolve(chosen);
      dialog.close();
    };
    const dialog = h(
      "dialog",
      {
        class: "help which",
        "aria-labelledby": "which-title",
        onclose: () => (resolve([]), dialog.remove()),
      },
      h(
        "div",
        { class: "help-body" },
        h("h2", { id: "which-title" }, t("{n} models: which is the scene?", { n: mains.length })),
        h("p", { class: "quiet" }, t("The other files may be parts of it. Or make each one a separate scene.")),
        h(
          "ul",
          { class: "which-list" },
          mains.map((main) =>
            h("li", null, h("button", { class: "button", type: "button", onclick: () => close([main]) }, main)),
          ),
        ),
        h(
          "div",
          { class: "row" },
          h("button", { class: "button primary", type: "button", onclick: () => close(mains) }, t("As separate scenes")),
          h("button", { class: "button", type: "button", onclick: () => close([]) }, t("Cancel")),
        ),
      ),
    );
    document.body.append(dialog);
    dialog.showModal();
  });
}
