/** The look of a live view: its exposure, which the page chooses for dark pictures and new lights until the user does, and its tone curve. */

import { h, setText } from "../base/dom.js";
import { stops } from "../base/format.js";
import { icon } from "../base/icons.js";
import { Store } from "../base/store.js";
import { t } from "../base/words.js";
import { curveOptions } from "../film/curves.js";
import { autoExposure, darkness } from "../film/darkness.js";
import { DEFAULT_CURVE } from "../film/tonemap.js";

/** @typedef {import("../film/darkness.js").Brightness} Brightness */
/** @typedef {"first" | "light" | "preview" | "done" | "user"} Chooser */

/** Stops at the ends of the exposure's slider, unless it is set beyond, and at most. */
const [USUAL_STOPS, MOST_STOPS] = [6, 16];

/** Difference in stops up to which the exposure that the preview mesh set is kept for its picture, since a jump is worse. */
const APART = 0.5;

/** @param {() => import("../film/film.js").Film} film the one that is shown */
export function exposureHand(film) {
  const slider = h("input", { class: "centred", type: "range", step: 0.25, "aria-label": t("Exposure in stops") });
  const curve = h("select", { "aria-label": t("Tone curve") }, curveOptions(DEFAULT_CURVE));
  const shown = h("span", { class: "small number quiet" });
  const auto = h(
    "button",
    { class: "button small", type: "button", title: t("Auto exposure (N)"), "aria-label": t("Auto exposure"), onclick: () => exposeAuto() },
    icon("exposure"),
    h("span", { class: "view-word" }, t("Auto")),
  );
  /** @param {boolean} is whether the page has chosen the exposure */
  const setAuto = (is) => auto.setAttribute("aria-pressed", String(is));
  setAuto(false);
  showExposure(slider, 0);
  const look = new Store({ exposure: 0, curve: DEFAULT_CURVE });
  const relook = () => look.set({ exposure: slider.valueAsNumber, curve: curve.value });
  /**
   * What chooses the exposure next: the first picture if it looks black; the preview or the next settled picture of a new light; that
   * picture, if the preview's exposure is far from its own; nothing more; or the user.
   *
   * @type {Chooser}
   */
  let chosenBy = "first";
  /** Exposures of earlier lights in stops, and what would choose them next. @type {Map<string, [number, Chooser]>} */
  const before = new Map();
  /** Whether the light is another than the first one. */
  let isRelit = false;
  /** The light that the exposure is for, without its strength: that is the user's own way to make it brighter. */
  let light = "";
  /** @param {number} exposure in stops */
  const set = (exposure) => {
    showExposure(slider, exposure);
    relook();
  };
  /** @param {number} exposure in stops, chosen by the user */
  const expose = (exposure) => {
    chosenBy = "user";
    set(exposure);
    setAuto(false);
  };
  const exposeAuto = () => {
    expose(autoExposure(film().brightness()));
    setAuto(true);
  };

  look.subscribe(({ exposure }) => {
    setText(shown, `${stops(exposure)} EV`);
    slider.setAttribute("aria-valuetext", `${stops(exposure)} EV`);
  });
  slider.addEventListener("input", () => expose(slider.valueAsNumber));
  slider.addEventListener("change", () => showExposure(slider, slider.valueAsNumber)); // at its end, the range grows
  slider.addEventListener("dblclick", () => expose(0));
  curve.addEventListener("change", relook);
  return {
    element: h("div", { class: "view-exposure" }, auto, slider, shown),
    curve,
    look,
    expose,
    exposeAuto,

    /** Sets a stored look. @param {number} exposure in stops @param {string} name of the curve; the default one replaces one that is not offered */
    restore(exposure, name) {
      curve.value = [...curve.options].some(({ value }) => value === name) ? name : DEFAULT_CURVE;
      expose(exposure);
    },

    /** Sets the look of a view that is opened: the default curve, and the exposure that the page chooses for what is shown. */
    reset() {
      curve.value = DEFAULT_CURVE;
      const brightness = film().brightness();
      const isChosen = isRelit || darkness(brightness) !== null;
      chosenBy = isChosen ? "done" : "first";
      set(isChosen ? autoExposure(brightness) : 0);
      setAuto(isChosen);
    },

    /** Whether the preview of a new light sets the exposure. */
    get awaitsPreview() {
      return chosenBy === "light";
    },

    /** Whether the next picture of a new light may set the exposure. */
    get awaitsLight() {
      return chosenBy === "light" || chosenBy === "preview";
    },

    /** Chooses the exposure for the preview of a new light. @param {Brightness | null} brightness null: it is black, so the picture chooses */
    adaptPreview(brightness) {
      chosenBy = "preview";
      if (!brightness) return;
      set(autoExposure(brightness));
      setAuto(true);
    },

    /**
     * Chooses the exposure for a picture, unless the user has.
     *
     * @param {Brightness} brightness
     * @param {boolean} isLatest whether it is of the latest request
     * @param {boolean} isSettled whether its samples are enough to judge it; a new light is exposed for the first such picture, once
     */
    adapt(brightness, isLatest, isSettled) {
      const isBlack = darkness(brightness) !== null;
      const isLightShown = (chosenBy === "light" || chosenBy === "preview") && isLatest && isSettled;
      if (!isLightShown && !(chosenBy === "first" && isBlack)) return;
      const exposure = autoExposure(brightness);
      const isKept = chosenBy === "preview" && Math.abs(exposure - slider.valueAsNumber) <= APART;
      chosenBy = "done";
      if (isKept) return;
      set(exposure);
      setAuto(true);
    },

    /** Takes note of a request's environment. @param {Record<string, any> | undefined} environment @returns {boolean} whether its light is another */
    noticeLight(environment) {
      const { strength: _, rotation: __, ...own } = environment ?? {};
      const text = JSON.stringify(own);
      const isOther = light !== "" && text !== light;
      if (isOther && chosenBy !== "user") {
        before.set(light, [slider.valueAsNumber, chosenBy]);
        const known = before.get(text);
        chosenBy = known?.[1] ?? "light";
        if (known) set(known[0]);
        setAuto(chosenBy !== "first");
      }
      light = text;
      isRelit ||= isOther;
      return isOther;
    },
  };
}

/** Sets the exposure's slider, whose range grows with the value. @param {HTMLInputElement} slider @param {number} value in stops */
function showExposure(slider, value) {
  const end = Math.abs(value) < USUAL_STOPS ? USUAL_STOPS : Math.min(2 * Math.ceil(Math.abs(value)), MOST_STOPS);
  slider.min = String(-end);
  slider.max = String(end);
  slider.value = String(value);
  slider.title = t("Exposure from {low} to {high} EV; double-click for 0", { low: stops(-end), high: stops(end) });
}
