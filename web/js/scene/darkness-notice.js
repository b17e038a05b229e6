/** A notice over a live view whose picture is dark or black: the reason, and buttons that help. */

import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { autoExposure, darkness } from "../film/darkness.js";
import { probe } from "./probe.js";

/** Stops by which a picture has to be too dark for an offer. */
const DULL_STOPS = 2;

/**
 * @param {object} view
 * @param {() => import("../film/film.js").Film} view.film the one that is shown
 * @param {import("../base/store.js").Store<{exposure: number, curve: string}>} view.look
 * @param {() => {width: number, height: number}} view.size of the latest request, in pixels
 * @param {(at: [number, number]) => void} view.pick requests the surface at a pixel
 * @param {() => boolean} view.isPicking whether an answer to a pick of the user is awaited
 * @param {() => void} view.brighten
 * @param {() => void} view.light chooses the studio's light
 * @param {() => void} view.reframe shows the whole scene
 */
export function darknessNotice({ film, look, size, pick, isPicking, brighten, light, reframe }) {
  const words = h("span");
  const button = (/** @type {import("../base/icons.js").IconName} */ symbol, /** @type {string} */ word, /** @type {() => void} */ onclick) =>
    h("button", { class: "button small", type: "button", onclick }, icon(symbol), word);
  const studio = button("sun", t("Studio light"), light);
  const brighter = button("exposure", t("Auto exposure"), brighten);
  const framing = button("camera", t("Frame the scene"), reframe);
  const element = h("div", { class: "view-dark", role: "status", hidden: true }, words, framing, brighter, studio);
  const probing = probe(pick);
  /** Brightness of the latest picture that was looked at. */
  let brightness = { white: 0, bright: 0, high: 0, key: 0 };
  /** Why the picture is exactly black: the camera sees no surface, or no light reaches those it sees; "": it is not, or that is not known yet. @type {"" | "empty" | "unlit"} */
  let blackness = "";
  /** Id of the latest black view that was probed. @type {number | null} */
  let probedView = null;

  const show = () => {
    const dark = darkness(brightness);
    const missing = autoExposure(brightness) - look.value.exposure;
    element.hidden = !dark && !blackness && missing < DULL_STOPS;
    studio.hidden = !dark && blackness !== "unlit";
    framing.hidden = blackness !== "empty";
    brighter.hidden = missing <= 0 || blackness !== "";
    if (!element.hidden) setText(words, wordsFor(blackness, dark));
  };
  const stopProbing = () => {
    probing.end();
    probedView = null;
  };
  const endBlackness = () => {
    stopProbing();
    if (!blackness) return;
    blackness = "";
    show();
  };
  look.subscribe(show);
  return {
    element,
    take: probing.take,
    stopProbing,
    endBlackness,
    dispose: probing.end,

    /** @param {import("../film/darkness.js").Brightness} found of a picture */
    look(found) {
      brightness = found;
      show();
    },

    /** Looks for the reason of a picture that is exactly black. @param {number} id of the view */
    explain(id) {
      if (!film().isBlack()) return endBlackness();
      if (probedView === id || isPicking()) return;
      probedView = id;
      probing.begin(size(), (seesSomething) => {
        blackness = seesSomething ? "unlit" : "empty";
        show();
      });
    },
  };
}

/** @param {"" | "empty" | "unlit"} blackness @param {import("../film/darkness.js").Darkness | null} dark */
function wordsFor(blackness, dark) {
  if (blackness === "empty") return t("The camera sees nothing");
  if (blackness === "unlit") return t("No light reaches what the camera sees");
  return dark ? t("Very dark: brightest {n}", { n: dark.brightest.toPrecision(1) }) : t("Dark at this exposure");
}
