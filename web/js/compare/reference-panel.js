/** Uploaded reference pictures: added by a drop or a button, and removed. */

import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { bytes } from "../base/format.js";
import { addReference, dropReference, loadReferences, references } from "../news/references.js";
import { registerLightReceiver } from "../shell/light-drop.js";
import { moreButton } from "../shell/more-button.js";
import { announce, showError } from "../shell/tray.js";
import { t } from "../base/words.js";
import { addressOf } from "./pictures.js";

/** @typedef {import("../base/types.js").Reference} Reference */
/** @typedef {import("../views/compare.js").Comparison} Comparison */

const REFERENCE_FILES = ".exr,.hdr,.pfm,.png,.jpg,.jpeg,.tif,.tiff,.webp";

/**
 * Accepts an image dropped on the page as A, the reference of measurements.
 *
 * @param {import("../base/store.js").Store<Comparison>} state
 * @param {import("../base/store.js").Disposer} life
 */
export function referencePanel(state, life) {
  const abort = new AbortController();
  life.add(() => abort.abort());
  const said = h("p", { class: "quiet small", role: "status", hidden: true });
  const list = h("ul", { class: "references plain" });
  const compareWith = (/** @type {Reference} */ reference) =>
    state.update((now) => {
      const a = addressOf(reference);
      if (now.b === a) return { ...now, a, atA: null, left: "", b: now.a, atB: now.atA, right: now.left };
      return now.a.startsWith("ref.") ? { ...now, a } : { ...now, a, atA: null, left: "", b: now.a, atB: now.atA, right: now.left };
    });
  const take = async (/** @type {File} */ file) => {
    said.hidden = false;
    said.textContent = t("Reading {name} …", { name: file.name });
    try {
      const added = await addReference(file, abort.signal);
      compareWith(added);
      announce(t("{name} is now A", { name: added.name }));
    } catch (error) {
      if (!abort.signal.aborted) showError(t("{name} was not accepted", { name: file.name }), error);
    } finally {
      said.hidden = true;
    }
  };
  life.add(registerLightReceiver((file) => void take(file)));
  const input = h("input", {
    ...{ type: "file", accept: REFERENCE_FILES, hidden: true, "aria-label": t("A reference picture") },
    onchange: () => {
      if (input.files?.[0]) void take(input.files[0]);
      input.value = "";
    },
  });
  const add = h("button", { class: "button for-submit", type: "button", onclick: () => input.click() }, icon("upload"), t("Add a reference picture"));
  const remove = (/** @type {Reference} */ reference) =>
    dropReference(reference.id).then(
      () => announce(t("{name} is removed", { name: reference.name })),
      (error) => showError(t("{name} was not removed", { name: reference.name }), error),
    );
  const show = () => {
    const { a, b } = state.value;
    fill(
      list,
      ...(references.value ?? []).map((reference) => {
        const isShown = [a, b].includes(addressOf(reference));
        const { name, width, height, display_referred: isDisplay, clipped } = reference;
        return h(
          "li",
          null,
          h(
            "button",
            { class: "link", type: "button", title: t("Compare with it"), "aria-pressed": String(isShown), onclick: () => compareWith(reference) },
            name,
          ),
          h("span", { class: "quiet small number" }, `${width}×${height} · ${bytes(reference.bytes)}`),
          !isShown &&
            h(
              "button",
              { class: "icon-button for-submit", type: "button", "aria-label": t("Remove {name}", { name }), onclick: () => void remove(reference) },
              icon("trash"),
            ),
          isDisplay && h("p", { class: "small warning" }, t("8 bits per channel, display-referred: a tone curve, if any, is still applied.")),
          clipped > 0 && h("p", { class: "small warning" }, t("{n} pixels are negative or too bright, and are clipped.", { n: clipped })),
        );
      }),
    );
  };
  life.add(references.subscribe(show));
  life.add(state.subscribe(show));
  const more = moreButton(references);
  life.add(more.dispose);
  if (!references.value) loadReferences().catch((error) => showError(t("The reference pictures could not be loaded"), error));
  return h(
    "section",
    { class: "side-section stack tight", "aria-label": t("Reference pictures") },
    h("h2", null, t("Reference pictures")),
    list,
    more.element,
    said,
    h("p", { class: "quiet small for-submit" }, t("Drop an EXR or HDR of the same size on the page. It is read as linear Rec.709.")),
    h("div", { class: "row" }, add, input),
  );
}
