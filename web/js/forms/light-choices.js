/** A row of thumbnails of environments, of which one is selected by a click or the arrow keys. */

import { fill, h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { progressBar } from "../shell/state-chip.js";
import { freshId } from "./fields.js";
import { t } from "../base/words.js";

/**
 * @typedef {object} Light
 * @property {string} id
 * @property {string} label
 * @property {string} help
 * @property {string} [picture] its address
 * @property {string} [face] class of a face without a picture; its id by default
 */

/**
 * @param {(id: string) => void} chosen by the user
 * @param {() => void} add one of the user's own
 */
export function lightChoices(chosen, add) {
  const name = freshId("light");
  const group = h("div", { class: "lights", role: "radiogroup", "aria-label": t("Environment light") });
  /** @type {Map<string, HTMLInputElement>} */
  const radios = new Map();
  let current = "";
  /** @type {HTMLElement[]} */
  const arriving = [];
  const adder = h("button", { class: "light add for-submit", type: "button", "aria-label": t("Add an HDRI"), title: t("Add an HDRI"), onclick: add }, h("span", { class: "face" }, icon("plus")), h("span", { class: "name" }, "HDRI"));
  /** @param {Light} light */
  const choice = ({ id, label, help, picture, face: look = id }) => {
    const radio = h("input", { type: "radio", name, value: id, onchange: () => ((current = id), chosen(id)) });
    radio.checked = id === current;
    radios.set(id, radio);
    const face = picture ? h("img", { src: picture, alt: "", width: 160, height: 80 }) : h("span", { class: `plain ${look}` });
    return h("label", { class: "light", title: help ? `${label}: ${help}` : label }, radio, h("span", { class: "face" }, face), h("span", { class: "name" }, label));
  };
  return {
    element: group,
    /** @param {Light[]} lights */
    show(lights) {
      const focused = [...radios].find(([, radio]) => radio === document.activeElement)?.[0];
      radios.clear();
      fill(group, lights.map(choice), arriving, adder);
      if (focused) radios.get(focused)?.focus();
    },
    /**
     * Shows an image that is being added, in the place where it will be offered.
     *
     * @param {File} file @param {() => void} cancel
     * @returns {{update: (fraction: number | null, words: string) => void, remove: () => void}} fraction: null: not known
     */
    await(file, cancel) {
      const name = file.name.replace(/\.\w+$/, "");
      const bar = progressBar(t("Adding {name}", { name: file.name }));
      const words = h("span", { class: "visually-hidden", role: "status" });
      const face = h("span", { class: "face" }, icon("image"));
      const url = /\.(exr|hdr|tiff?)$/i.test(file.name) ? "" : URL.createObjectURL(file); // the others are shown by all browsers
      if (url) fill(face, h("img", { src: url, alt: "" }));
      const label = t("Cancel adding {name}", { name: file.name });
      const element = h("button", { class: "light arriving", type: "button", "aria-label": label, title: label, onclick: cancel }, face, h("span", { class: "name" }, name), words);
      face.append(h("span", { class: "cancel", "aria-hidden": "true" }, icon("close")), bar.element);
      arriving.push(element);
      adder.before(element);
      return {
        update(fraction, said) {
          bar.update(fraction);
          setText(words, said);
          element.title = `${said}\n${label}`;
        },
        remove() {
          arriving.splice(arriving.indexOf(element), 1);
          element.remove();
          URL.revokeObjectURL(url);
        },
      };
    },
    /** @param {string} id */
    select(id) {
      current = id;
      for (const [each, radio] of radios) radio.checked = each === id;
    },
  };
}
