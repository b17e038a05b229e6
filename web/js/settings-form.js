/** What a picture is asked to be: the form on a scene's page. It owns its fields and gives back a job request. */

import { linearOf } from "./colour.js";
import { h, setText } from "./dom.js";
import { jobs, workers } from "./farm.js";
import { field, numberInput, numberOf, segments } from "./fields.js";
import { compact, count, plural, roughly } from "./format.js";
import { icon } from "./icons.js";
import { DEFAULT_ASPECT, QUALITIES, SIZES, expectedSpeed, sizeOf } from "./render-presets.js";
import { viewFields } from "./view-fields.js";

/** @typedef {import("./types.js").Scene} Scene */
/** @typedef {import("./types.js").JobRequest} JobRequest */

const MAX_SIZE = 16384;
const MAX_SPP = 1 << 20;
const AUTO_CAMERA = "auto"; // the one that every scene has
const CUSTOM = "custom";
const OWN_VIEW = "\0view"; // no camera's name has a NUL in it

/**
 * @param {Scene} scene ready
 * @param {(request: JobRequest) => Promise<void>} submit
 * @returns {{element: HTMLFormElement, update: () => void}} update: the farm's speed may have changed
 */
export function settingsForm(scene, submit) {
  const { defaults } = scene;
  let aspect = defaults.width && defaults.height ? defaults.width / defaults.height : DEFAULT_ASPECT;

  const camera = h("select", null, scene.cameras.map(({ name }) => h("option", { value: name }, name === AUTO_CAMERA ? "Automatic: frames the scene" : name)), h("option", { value: OWN_VIEW }, "Custom view …"));
  const view = viewFields(scene.cameras[0]?.view);
  view.element.hidden = true;
  camera.addEventListener("change", () => {
    view.element.hidden = camera.value !== OWN_VIEW;
    const chosen = scene.cameras.find(({ name }) => name === camera.value);
    if (chosen) view.set(chosen.view);
  });

  // Size
  const start = defaults.width && defaults.height ? { width: defaults.width, height: defaults.height } : sizeOf(1280, aspect);
  const width = numberInput({ value: start.width, min: 1, max: MAX_SIZE });
  const height = numberInput({ value: start.height, min: 1, max: MAX_SIZE });
  const keep = h("input", { type: "checkbox", checked: true });
  const customSize = h("div", { class: "stack" }, h("div", { class: "pair" }, field("Width", width), field("Height", height)), h("label", { class: "check" }, keep, "Keep the aspect"));
  const size = segments("Size", [...SIZES.map(({ name, label }) => ({ value: name, label })), { value: CUSTOM, label: "Custom" }], CUSTOM, (value) => {
    const preset = SIZES.find(({ name }) => name === value);
    customSize.hidden = !!preset;
    if (preset) setSize(sizeOf(preset.long, aspect));
    else width.focus();
  });
  /** @param {{width: number, height: number}} to */
  const setSize = (to) => {
    width.value = String(to.width);
    height.value = String(to.height);
    update();
  };
  width.addEventListener("input", () => {
    if (keep.checked) height.value = String(Math.max(1, Math.round(numberOf(width, 1) / aspect)));
    else aspect = numberOf(width, 1) / Math.max(1, numberOf(height, 1));
  });
  height.addEventListener("input", () => {
    if (keep.checked) width.value = String(Math.max(1, Math.round(numberOf(height, 1) * aspect)));
    else aspect = numberOf(width, 1) / Math.max(1, numberOf(height, 1));
  });
  const preset = SIZES.find(({ long }) => sizeOf(long, aspect).width === start.width && sizeOf(long, aspect).height === start.height);
  size.select(preset?.name ?? CUSTOM);
  customSize.hidden = !!preset;

  // Quality
  const spp = numberInput({ value: defaults.spp ?? 128, min: 1, max: MAX_SPP });
  const customSpp = field("Samples per pixel", spp);
  const quality = segments("Quality", [...QUALITIES.map((q) => ({ value: q.name, label: q.label })), { value: CUSTOM, label: "Custom" }], CUSTOM, (value) => {
    const chosen = QUALITIES.find(({ name }) => name === value);
    customSpp.hidden = !!chosen;
    if (chosen) spp.value = String(chosen.spp);
    else spp.focus();
    update();
  });
  const chosenQuality = QUALITIES.find((q) => q.spp === Number(spp.value));
  quality.select(chosenQuality?.name ?? CUSTOM);
  customSpp.hidden = !!chosenQuality;

  // Advanced
  const noise = numberInput({ min: 0.01, max: 100, step: "any", required: false, placeholder: "off" });
  const seconds = numberInput({ min: 1, step: "any", required: false, placeholder: "off" });
  const depth = numberInput({ value: defaults.max_depth ?? 8, min: 1, max: 1024 });
  const seed = numberInput({ value: defaults.seed ?? 0, min: 0, max: 2 ** 32 - 1 });
  const strength = numberInput({ value: defaults.environment_strength ?? 1, min: 0, max: 1e6, step: "any" });
  const replace = h("input", { type: "checkbox" });
  const colour = h("input", { type: "color", value: "#ffffff", "aria-label": "Environment colour" });
  colour.disabled = true;
  replace.addEventListener("change", () => (colour.disabled = !replace.checked));
  const advanced = h(
    "details",
    { class: "advanced" },
    h("summary", null, "Advanced"),
    h(
      "div",
      { class: "stack" },
      h("div", { class: "pair" }, field("Stop at noise, %", noise, "Ends where the error is this small"), field("Stop after, s", seconds, "Whichever comes first ends it")),
      h("div", { class: "pair" }, field("Max depth", depth, "Path segments, the camera's included"), field("Seed", seed, "Another seed, other noise")),
      h("div", { class: "pair" }, field("Environment strength", strength), h("div", { class: "field" }, h("label", { class: "check" }, replace, "Replace by colour"), colour)),
    ),
  );

  // What it costs
  const estimate = h("p", { class: "estimate quiet small number" });
  const render = h("button", { class: "button primary large wide", type: "submit" }, icon("play"), "Render");
  const update = () => {
    const pixels = numberOf(width, 0) * numberOf(height, 0);
    const samples = pixels * numberOf(spp, 0);
    const all = workers.value ?? [];
    const slots = all.reduce((sum, worker) => sum + worker.slots, 0);
    const speed = expectedSpeed(all, jobs.value ?? [], scene.id);
    setText(size.aside, `${numberOf(width, 0)} × ${numberOf(height, 0)}`);
    setText(quality.aside, `${plural(numberOf(spp, 0), "sample")} per pixel`);
    const cost = `${compact(samples)} samples`;
    if (!slots) setText(estimate, `${cost}. Waits for a worker.`);
    else if (!speed) setText(estimate, `${cost} on ${plural(slots, "slot")}. The time is known once they have rendered something.`);
    else setText(estimate, `${cost}, ${roughly(samples / speed)} on ${plural(slots, "slot")}`);
    estimate.title = `${count(pixels)} pixels × ${count(numberOf(spp, 0))} samples`;
  };

  /** @returns {JobRequest} */
  const request = () => ({
    scene: scene.id,
    ...(camera.value === OWN_VIEW ? { view: view.get() } : { camera: camera.value }),
    width: width.valueAsNumber,
    height: height.valueAsNumber,
    spp: spp.valueAsNumber,
    ...(noise.value && { noise: noise.valueAsNumber / 100 }),
    ...(seconds.value && { seconds: seconds.valueAsNumber }),
    max_depth: depth.valueAsNumber,
    seed: seed.valueAsNumber,
    environment: { strength: strength.valueAsNumber, color: replace.checked ? linearOf(colour.value) : null },
  });

  const element = h(
    "form",
    {
      class: "settings",
      "aria-label": "Render settings",
      oninput: update,
      onsubmit: async (/** @type {SubmitEvent} */ event) => {
        event.preventDefault();
        render.disabled = true;
        try {
          await submit(request());
        } finally {
          render.disabled = false;
        }
      },
    },
    field("Camera", camera),
    view.element,
    size.element,
    customSize,
    quality.element,
    customSpp,
    advanced,
    h("div", { class: "submit" }, estimate, render),
  );
  // A field that is out of range must be seen to be mended.
  element.addEventListener("invalid", () => (advanced.open = true), { capture: true });
  update();
  return { element, update };
}
