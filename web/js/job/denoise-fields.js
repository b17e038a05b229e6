/** The denoised picture: instead of the raw one or beside it, why it could not be made, and whether it is outdated. Its tag on the stage has its progress. */

import { h, setText } from "../base/dom.js";
import { segments } from "../forms/fields.js";
import { icon } from "../base/icons.js";
import { t, tn } from "../base/words.js";
import { count } from "../base/format.js";

/** @typedef {import("../film/picture-side.js").SideState} SideState */
/** @typedef {import("../base/store.js").Store<import("./display-panel.js").Display>} DisplayStore */

export const DENOISE_MODES = /** @type {const} */ (["off", "wipe", "on"]);

/**
 * @param {DisplayStore} display
 * @param {() => void} renew denoises what the film has now
 * @returns {{element: HTMLElement, update: (state: SideState | null) => void}} update: with null if nothing is denoised
 */
export function denoiseFields(display, renew) {
  const choice = segments(
    t("Denoise"),
    [
      { value: "off", label: t("Off") },
      { value: "wipe", label: t("Split") },
      { value: "on", label: t("On") },
    ],
    (value) => display.update((d) => ({ ...d, denoise: /** @type {typeof d.denoise} */ (value) })),
  );
  const why = h("p", { class: "quiet small", hidden: true });
  display.subscribe((look) => {
    choice.select(look.denoise);
    const reason = whyNotDenoised(look);
    for (const radio of choice.element.querySelectorAll("input")) radio.disabled = reason !== "";
    setText(why, reason);
    why.hidden = reason === "";
  });
  const said = h("p", { class: "small", role: "status", hidden: true });
  const again = h(
    "button",
    { class: "button", type: "button", hidden: true, onclick: renew },
    icon("refresh"),
    t("Denoise again"),
  );
  const element = h("div", { class: "stack tight", hidden: true }, choice.element, why, said, again);
  return {
    element,
    update(state) {
      const { error, waiting = false, stale = false, isPreview = false, spp = 0 } = state ?? {};
      setText(choice.aside, spp === 0 || error ? "" : tn(spp, "Made of the first sample", "Made of the first {n} samples", { n: count(spp) }));
      const sentence = waiting
        ? ""
        : error
          ? t("Not denoised. {error}", { error: error instanceof Error ? error.message : String(error) })
          : stale && !isPreview
            ? t("New samples have come since it was denoised.")
            : "";
      setText(said, sentence);
      again.hidden = said.hidden = sentence === "";
      said.classList.toggle("bad", Boolean(error));
    },
  };
}

/**
 * Returns why the picture cannot be denoised as it is displayed; "" if it can.
 *
 * @param {Pick<import("./display-panel.js").Display, "channel">} look
 */
export const whyNotDenoised = ({ channel }) => (channel === "" ? "" : t("Only the colour can be denoised"));

/** Whether a connected worker can denoise. @param {import("../base/types.js").Worker[] | null} all */
export const canDenoise = (all) => (all ?? []).some(({ denoises }) => denoises);
