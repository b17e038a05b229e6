/** How the picture is shown: exposure, tone curve, channel. The state is a store; sliders, keys and the URL all write it. */

import { h, setText } from "./dom.js";
import { field } from "./fields.js";
import { stops } from "./format.js";
import { here, setParams } from "./router.js";
import { CURVES, DEFAULT_CURVE } from "./tonemap.js";
import { Store } from "./store.js";

/**
 * @typedef {object} Display
 * @property {number} exposure stops
 * @property {string} curve
 * @property {string} channel "" for the colour, or an AOV
 * @property {boolean} outlines of the tiles that are being rendered
 */

export const CHANNELS = [
  { name: "", label: "Colour" },
  { name: "albedo", label: "Albedo" },
  { name: "normal", label: "Normal" },
  { name: "depth", label: "Depth" },
];

export const EXPOSURE_STEP = 0.5;
const EXPOSURE_RANGE = 12;

/** @returns {Store<Display>} as the URL says, and written back to it */
export function displayFromUrl() {
  const { params } = here();
  const curve = params.get("tone") ?? DEFAULT_CURVE;
  const channel = params.get("aov") ?? "";
  const store = new Store({
    exposure: clampExposure(Number(params.get("ev") ?? 0) || 0),
    curve: CURVES.some(({ name }) => name === curve) ? curve : DEFAULT_CURVE,
    channel: CHANNELS.some(({ name }) => name === channel) ? channel : "",
    outlines: params.get("tiles") !== "0",
  });
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  store.subscribe(({ exposure, curve, channel, outlines }) => {
    // Browsers throttle history changes; a dragged slider makes sixty a second.
    clearTimeout(timer);
    const { path } = here();
    timer = setTimeout(() => {
      if (here().path.join() !== path.join()) return;
      setParams({
        ev: exposure === 0 ? null : String(exposure),
        tone: curve === DEFAULT_CURVE ? null : curve,
        aov: channel || null,
        tiles: outlines ? null : "0",
      });
    }, 300);
  });
  return store;
}

/** @param {number} exposure rounded to what the slider shows */
export function clampExposure(exposure) {
  return Math.min(Math.max(Math.round(exposure * 10) / 10, -EXPOSURE_RANGE), EXPOSURE_RANGE);
}

/**
 * @param {Store<Display>} display
 * @param {{normalise: () => void}} actions
 * @returns {HTMLElement}
 */
export function displayPanel(display, { normalise }) {
  const value = h("output", { class: "mono" });
  const slider = h("input", {
    type: "range",
    class: "centred",
    ...{ min: -EXPOSURE_RANGE, max: EXPOSURE_RANGE, step: 0.1 },
    oninput: () => display.update((d) => ({ ...d, exposure: clampExposure(slider.valueAsNumber) })),
    ondblclick: () => display.update((d) => ({ ...d, exposure: 0 })),
  });
  const curve = h(
    "select",
    { onchange: () => display.update((d) => ({ ...d, curve: curve.value })) },
    CURVES.map(({ name, label, hint }) => h("option", { value: name, title: hint }, label)),
  );
  const channel = h(
    "select",
    { onchange: () => display.update((d) => ({ ...d, channel: channel.value })) },
    CHANNELS.map(({ name, label }) => h("option", { value: name }, label)),
  );
  const outlines = h("input", {
    type: "checkbox",
    onchange: () => display.update((d) => ({ ...d, outlines: outlines.checked })),
  });
  const exposure = field("Exposure", slider);
  const reset = h(
    "button",
    {
      class: "text-button small",
      type: "button",
      title: "Back to 0 (R)",
      onclick: () => display.update((d) => ({ ...d, exposure: 0 })),
    },
    "Reset",
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
        { class: "text-button small", type: "button", title: "Bring the brightest below 1 (N)", onclick: normalise },
        "Normalise",
      ),
    ),
  );
  const colourOnly = h("div", { class: "stack" }, exposure, field("Tone curve", curve));
  display.subscribe((d) => {
    setText(value, `${stops(d.exposure)} EV`);
    slider.valueAsNumber = d.exposure;
    slider.setAttribute("aria-valuetext", `${d.exposure.toFixed(1)} stops`);
    reset.hidden = d.exposure === 0;
    curve.value = d.curve;
    channel.value = d.channel;
    outlines.checked = d.outlines;
    colourOnly.hidden = d.channel !== "";
  });
  return h(
    "section",
    { class: "side-section stack", "aria-label": "Display" },
    field("Channel", channel),
    colourOnly,
    h("label", { class: "check" }, outlines, "Outline tiles being rendered"),
  );
}
