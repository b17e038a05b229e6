/**
 * The display options of a picture: exposure, tone curve, channel, denoising. The state is a store, which sliders, keys and the
 * URL modify.
 */

import { jobLook } from "../film/job-look.js";
import { channels, lightGroupOf, lightGroups } from "../film/channels.js";
import { PARTS } from "../film/film-shader.js";
import { mayHaveHighRange } from "../film/high-range.js";
import { mixFrom, mixText } from "../film/light-mix.js";
import { heatBar, partFields } from "./part-fields.js";
import { pinsFrom, pinsText } from "./pins.js";
import { DENOISE_MODES, denoiseFields } from "./denoise-fields.js";
import { icon } from "../base/icons.js";
import { fill, h, setText } from "../base/dom.js";
import { field } from "../forms/fields.js";
import { stops } from "../base/format.js";
import { here, setParams } from "../shell/router.js";
import { curveOptions, isCurve } from "../film/curves.js";
import { DEFAULT_CURVE } from "../film/tonemap.js";
import { Store } from "../base/store.js";
import { t, tn } from "../base/words.js";

/**
 * @typedef {object} Display
 * @property {number} exposure stops
 * @property {string} curve
 * @property {string} channel "" for the colour, or an AOV
 * @property {string} part of the light: see film-shader.js' PARTS
 * @property {import("./pins.js").Pin[]} pins
 * @property {"off" | "wipe" | "on"} denoise
 * @property {number} wipe how much of the width is the raw picture's, where it lies beside the denoised one
 * @property {readonly import("../film/light-mix.js").Strip[]} mix one per light group of the job; the colour is shown so
 * @property {boolean} outlines of the tiles that are being rendered
 * @property {boolean} high whether the display's high dynamic range is used
 */

export const EXPOSURE_STEP = 0.5;
const EXPOSURE_RANGE = 16;
/** The choice of high dynamic range is this browser's, not the link's: it depends on the display. */
const HIGH_KEY = "rayfarm-hdr";

/**
 * @param {Pick<import("../base/types.js").Job, "settings" | "exposure" | "tonemap">} job for its light groups, and its look where the URL has none
 * @returns {Store<Display>} initialized from the URL, and written back to it
 */
export function displayFromUrl(job) {
  const { settings } = job;
  const usual = jobLook(job);
  const { params } = here();
  const channel = params.get("aov") ?? "";
  const denoise = DENOISE_MODES.find((mode) => mode === params.get("denoise")) ?? "off";
  /** @type {Store<Display>} */
  const store = new Store({
    ...lookFromUrl(params, usual),
    channel: lightGroupOf(channel) !== null || channels().some(({ name }) => name === channel) ? channel : "",
    part: PARTS.some(({ name }) => name === params.get("part")) ? (params.get("part") ?? "") : "",
    pins: pinsFrom(params.get("pins")),
    denoise,
    wipe: wipeFrom(params.get("wipe")),
    mix: mixFrom(params.get("mix"), lightGroups(settings)),
    outlines: params.get("tiles") !== "0",
    high: mayHaveHighRange() && readHigh(),
  });
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  store.subscribe(({ exposure, curve, channel, part, pins, denoise, wipe, mix, outlines }) => {
    // Browsers throttle history changes; dragging a slider makes sixty per second.
    clearTimeout(timer);
    const { path } = here();
    timer = setTimeout(() => {
      if (here().path.join() !== path.join()) return;
      setParams({
        ...lookParams({ exposure, curve }, usual),
        aov: channel || null,
        part: part || null,
        pins: pinsText(pins),
        denoise: denoise === "off" ? null : denoise,
        wipe: denoise !== "wipe" || wipe === 0.5 ? null : wipe.toFixed(3),
        mix: mixText(mix),
        tiles: outlines ? null : "0",
      });
    }, 300);
  });
  return store;
}

function readHigh() {
  try {
    return localStorage.getItem(HIGH_KEY) === "on";
  } catch {
    return false; // storage is blocked
  }
}

/** @param {boolean} on */
function keepHigh(on) {
  try {
    localStorage.setItem(HIGH_KEY, on ? "on" : "off");
  } catch {
    // Storage is blocked: the choice lasts until the page is closed.
  }
}

/** @typedef {{exposure: number, curve: string}} Look */

/** @param {URLSearchParams} params @param {Look} usual where the URL has none @returns {Look} */
export function lookFromUrl(params, usual) {
  const curve = params.get("tone") ?? usual.curve;
  return {
    exposure: clampExposure(Number(params.get("ev") ?? usual.exposure) || 0),
    curve: isCurve(curve) ? curve : DEFAULT_CURVE,
  };
}

/** @param {Look} look @param {Look} usual without a parameter @returns {Record<string, string | null>} for the URL */
export const lookParams = ({ exposure, curve }, usual) => ({
  ev: exposure === clampExposure(usual.exposure) ? null : String(exposure),
  tone: curve === usual.curve ? null : curve,
});

/** @param {string | null} text of the URL @returns {number} 0..1; 0.5 if the URL has none */
export function wipeFrom(text) {
  const fraction = Number(text ?? 0.5);
  return fraction >= 0 && fraction <= 1 ? fraction : 0.5;
}

/** @param {number} exposure rounded to what the slider shows */
export function clampExposure(exposure) {
  return Math.min(Math.max(Math.round(exposure * 10) / 10, -EXPOSURE_RANGE), EXPOSURE_RANGE);
}

/**
 * @param {Store<Display>} display
 * @param {Record<string, any> | null} settings the job's, for its light groups
 * @param {{normalise: () => void, denoise: () => void, usual: number}} actions denoise: anew, the picture having more samples now; usual: the job's exposure, in stops
 * @returns {{element: HTMLElement, outlined: HTMLElement, updateDenoise: (state: import("../film/picture-side.js").SideState | null) => void, updateHeat: (state: import("../film/picture-side.js").SideState | null) => void, offerDenoise: (can: boolean) => void, update: (job: import("../base/types.js").Job) => void, showHands: (outlines: import("../film/pixel-overlay.js").Outline[]) => void}}
 */
export function displayPanel(display, settings, { normalise, denoise: renew, usual }) {
  const exposure = exposureField(display, normalise, usual);
  const curve = curveField(display);
  const denoise = denoiseFields(display, renew);
  const channel = h(
    "select",
    { onchange: () => display.update((d) => ({ ...d, channel: channel.value })) },
    channels(settings).map(({ name, label }) => h("option", { value: name }, label)),
  );
  const channelField = field(t("Channel"), channel, " ");
  const hint = /** @type {HTMLElement} */ (channelField.lastElementChild);
  const outlines = h("input", {
    type: "checkbox",
    onchange: () => display.update((d) => ({ ...d, outlines: outlines.checked })),
  });
  const outline = h("label", { class: "check" }, outlines, t("Outline tiles being rendered"));
  const high = h("input", { type: "checkbox", checked: display.value.high, onchange: () => (keepHigh(high.checked), display.update((d) => ({ ...d, high: high.checked }))) });
  const highLabel = h("label", { class: "check", title: t("Highlights brighter than white, on displays of high dynamic range"), hidden: !mayHaveHighRange() }, high, "HDR");
  const denoiseBox = h("div", null, denoise.element);
  const colourOnly = h("div", { class: "stack" }, partFields(display), exposure, highLabel, denoiseBox);
  const heat = h("div", { hidden: true });
  display.subscribe((d) => {
    channel.value = d.channel;
    const told = channels(settings).find(({ name }) => name === d.channel)?.help ?? "";
    setText(hint, told);
    hint.hidden = told === "";
    outlines.checked = d.outlines;
    colourOnly.hidden = curve.hidden = d.channel !== "" && lightGroupOf(d.channel) === null;
    denoiseBox.hidden = d.channel !== "";
  });
  const legend = h("ul", { class: "workers-legend", "aria-label": t("Workers on this picture"), hidden: true });
  let shown = "";
  /** @type {{name: string, colour: string, tiles: number}[]} */
  let hands = [];
  const showWorkers = () => {
    const key = JSON.stringify([hands, display.value.outlines]);
    if (key === shown) return;
    shown = key;
    legend.hidden = !display.value.outlines || hands.length === 0;
    fill(
      legend,
      ...hands.map(({ name, colour, tiles }) => {
        const swatch = h("span", { class: "swatch" });
        swatch.style.background = colour;
        return h("li", null, swatch, h("span", null, name), h("span", { class: "quiet number" }, tn(tiles, "{n} tile", "{n} tiles")));
      }),
    );
  };
  display.subscribe(showWorkers);
  const element = h(
    "section",
    { class: "side-section stack", "aria-label": t("Display") },
    h("div", { class: "look-choices" }, channelField, curve),
    heat,
    colourOnly,
  );
  const outlined = h("section", { class: "side-section stack tight", "aria-label": t("Tiles") }, outline, legend);
  /** @param {boolean} can */
  const offerDenoise = (can) => (denoise.element.hidden = !can && display.value.denoise === "off");
  /** Offers outlines only while tiles are, or may still be, rendered. @param {import("../base/types.js").Job} job */
  const update = ({ state }) => {
    const isOpen = ["queued", "running", "paused"].includes(state);
    outlined.hidden = !isOpen;
  };
  /** @param {import("../film/pixel-overlay.js").Outline[]} outlines of the tiles in hand */
  const showHands = (outlines) => {
    const names = [...new Set(outlines.map(({ worker }) => worker))].sort();
    hands = names.map((name) => {
      const own = outlines.filter(({ worker }) => worker === name);
      return { name, colour: own[0]?.colour ?? "", tiles: own.length };
    });
    showWorkers();
  };
  /** Updates the legend of the plane's heat map. @param {import("../film/picture-side.js").SideState | null} state */
  const updateHeat = (state) => {
    const span = state?.span;
    const name = channels(settings).find((each) => each.name === state?.channel)?.label ?? "";
    heat.hidden = !span;
    if (span) fill(heat, heatBar(name, span[0], span[1]));
  };
  return { element, outlined, updateDenoise: denoise.update, updateHeat, offerDenoise, update, showHands };
}

/**
 * Fields of exposure and tone curve.
 *
 * @template {{exposure: number, curve: string}} T
 * @param {Store<T>} display
 * @param {() => void} normalise
 * @param {HTMLElement} more below the exposure
 * @returns {HTMLElement}
 */
export const lookFields = (display, normalise, more) => h("div", { class: "stack" }, exposureField(display, normalise), more, curveField(display));

/**
 * @template {{curve: string}} T
 * @param {Store<T>} display
 * @returns {HTMLElement}
 */
function curveField(display) {
  const curve = h(
    "select",
    { onchange: () => display.update((d) => ({ ...d, curve: curve.value })) },
    curveOptions(display.value.curve),
  );
  display.subscribe((d) => (curve.value = d.curve));
  return field(t("Tone curve"), curve);
}

/**
 * @template {{exposure: number}} T
 * @param {Store<T>} display
 * @param {() => void} normalise
 * @param {number} [usual] exposure that *Reset* sets, in stops
 * @returns {HTMLElement}
 */
function exposureField(display, normalise, usual = 0) {
  const value = h("output", { class: "mono" });
  const slider = h("input", {
    type: "range",
    class: "centred",
    ...{ min: -EXPOSURE_RANGE, max: EXPOSURE_RANGE, step: 0.1 },
    oninput: () => display.update((d) => ({ ...d, exposure: clampExposure(slider.valueAsNumber) })),
    ondblclick: () => display.update((d) => ({ ...d, exposure: 0 })),
  });
  const exposure = field(t("Exposure"), slider);
  const reset = h(
    "button",
    {
      class: "icon-button exposure-reset",
      type: "button",
      "aria-label": t("Reset"),
      title: t("Reset (R)"),
      onclick: () => display.update((d) => ({ ...d, exposure: clampExposure(usual) })),
    },
    icon("undo"),
  );
  exposure.prepend(
    h(
      "div",
      { class: "row" },
      exposure.firstElementChild,
      value,
      h("span", { class: "grow" }),
      reset,
      h(
        "button",
        { class: "text-button small", type: "button", title: t("Bring the brightest below 1 (N)"), onclick: normalise },
        t("Fit exposure"),
      ),
    ),
  );
  display.subscribe((d) => {
    setText(value, `${stops(d.exposure)} EV`);
    slider.valueAsNumber = d.exposure;
    slider.setAttribute("aria-valuetext", `${d.exposure.toFixed(1)} stops`);
    reset.style.visibility = d.exposure === clampExposure(usual) ? "hidden" : ""; // keeps its space, so that the slider does not move while dragged
  });
  return exposure;
}
