/** A notice over a live view whose picture is dark or black: the reason, and buttons that help. */

import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { autoExposure, darkness } from "../film/darkness.js";
import { probe } from "./probe.js";

/** State of a picture: not black; exactly black for an unknown reason; black since the camera sees no surface; black since no light reaches what it sees. @typedef {"" | "black" | "empty" | "unlit"} Blackness */

/** Stops by which a picture has to be too dark for an offer. */
const DULL_STOPS = 2;

/**
 * @param {object} view
 * @param {() => import("../film/film.js").Film} view.film the one that is shown
 * @param {import("../base/store.js").Store<{exposure: number, curve: string}>} view.look
 * @param {() => {width: number, height: number}} view.size of the latest request, in pixels
 * @param {(at: [number, number]) => void} view.pick requests the surface at a pixel
 * @param {() => boolean} view.isPicking whether an answer to a pick of the user is awaited
 * @param {() => boolean} view.mayShow whether the camera may see some of the scene; false is certain
 * @param {() => string} view.invisible why nothing of the scene can be seen from any side; empty where something may be
 * @param {() => void} view.brighten
 * @param {() => void} view.light chooses the studio's light
 * @param {() => void} view.reframe shows the whole scene
 * @param {(words: string, remedy: {word: string, run: () => void} | null) => void} view.setCaution says why a picture would be empty or black, and offers a remedy; "": it would not be, as far as is known
 */
export function darknessNotice({ film, look, size, pick, isPicking, mayShow, invisible, brighten, light, reframe, setCaution }) {
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
  /** Why the picture is exactly black; "": it is not, or not known to be. @type {Blackness} */
  let blackness = "";
  /** Id of the latest black view that was probed. @type {number | null} */
  let probedView = null;

  const show = () => {
    const dark = darkness(brightness);
    const missing = autoExposure(brightness) - look.value.exposure;
    const nothing = invisible();
    if (nothing) {
      setCaution(t("The picture will show nothing of the file."), null);
      for (const remedy of [studio, framing, brighter]) remedy.hidden = true; // none helps
      element.hidden = false;
      return setText(words, nothing);
    }
    if (blackness === "unlit") setCaution(t("The picture will be black, since no light reaches what the camera sees."), { word: t("Add studio light"), run: light });
    else if (blackness === "empty") setCaution(t("The picture will be black, since the camera sees nothing."), { word: t("Frame the scene"), run: reframe });
    else setCaution("", null);
    element.hidden = !dark && !blackness && missing < DULL_STOPS;
    studio.hidden = !dark && blackness !== "unlit";
    framing.hidden = !["empty", "black"].includes(blackness);
    brighter.hidden = missing <= 0 || blackness !== "";
    if (!element.hidden) setText(words, wordsFor(blackness, dark));
  };
  const stopProbing = () => {
    probing.end();
    probedView = null;
  };
  /** @param {Blackness} next */
  const setBlackness = (next) => {
    if (next === blackness) return;
    blackness = next;
    show();
  };
  const endBlackness = () => {
    stopProbing();
    setBlackness("");
  };
  /** Whether the black view that was probed shows surfaces; null: not known yet. @type {boolean | null} */
  let seesSomething = null;
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

    /** Says at once, before any sample, that nothing of the scene can be seen, or that the camera sees nothing of it before a black background, where that is certain. @param {boolean} isBlackBehind */
    warnEarly(isBlackBehind) {
      if (invisible()) show();
      else if (isBlackBehind && !mayShow()) setBlackness("empty");
    },

    /**
     * Looks for the reason of a picture that is exactly black.
     *
     * @param {number} id of the view
     * @param {boolean} isSure whether it has enough samples to have found light that only rare paths reach
     */
    explain(id, isSure) {
      if (!film().isBlack() || invisible()) return endBlackness();
      if (!mayShow()) return setBlackness("empty");
      if (probedView !== id) seesSomething = null;
      const found = seesSomething && isSure ? "unlit" : seesSomething === false ? "empty" : "black";
      setBlackness(found);
      if (probedView === id || isPicking()) return;
      probedView = id;
      probing.begin(size(), (sees) => {
        seesSomething = sees;
        if (!sees) setBlackness("empty");
        else if (isSure) setBlackness("unlit");
      });
    },
  };
}

/** @param {Blackness} blackness @param {import("../film/darkness.js").Darkness | null} dark */
function wordsFor(blackness, dark) {
  if (blackness === "empty") return t("The camera sees nothing");
  if (blackness === "unlit") return t("No light reaches what the camera sees");
  if (blackness === "black") return t("Nothing visible");
  return dark ? t("Very dark: brightest {n}", { n: dark.brightest.toPrecision(1) }) : t("Dark at this exposure");
}
