/** What a picture is asked to be: the form on a scene's page, and what it will cost. */

import { advancedFields } from "./advanced-fields.js";
import { h, setText } from "./dom.js";
import { jobs, workers } from "./farm.js";
import { field } from "./fields.js";
import { compact, plural, roughly } from "./format.js";
import { icon } from "./icons.js";
import { qualityFields } from "./quality-fields.js";
import { expectedSpeed } from "./render-presets.js";
import { sizeFields } from "./size-fields.js";
import { viewFields } from "./view-fields.js";

/** @typedef {import("./types.js").Scene} Scene */
/** @typedef {import("./types.js").JobRequest} JobRequest */

const AUTO_CAMERA = "auto"; // the one that every scene has
const OWN_VIEW = "\0view"; // no camera's name has a NUL in it

/**
 * @param {Scene} scene ready
 * @param {(request: JobRequest) => Promise<void>} submit
 * @returns {{element: HTMLFormElement, update: () => void}} update: the farm's speed may have changed
 */
export function settingsForm(scene, submit) {
  const camera = cameraFields(scene);
  const estimate = h("p", { class: "quiet small number" });
  const update = () => setText(estimate, costOf(scene, size.get(), quality.get()));
  const size = sizeFields(scene.defaults, () => update());
  const quality = qualityFields(scene.defaults, () => update());
  const advanced = advancedFields(scene.defaults);
  const render = h("button", { class: "button primary large wide", type: "submit" }, icon("play"), "Render");
  const onsubmit = async (/** @type {SubmitEvent} */ event) => {
    event.preventDefault();
    render.disabled = true;
    try {
      await submit({ scene: scene.id, ...camera.get(), ...size.get(), spp: quality.get(), ...advanced.get() });
    } finally {
      render.disabled = false;
    }
  };
  const element = h(
    "form",
    { class: "settings", "aria-label": "Render settings", onsubmit },
    camera.elements,
    size.elements,
    quality.elements,
    advanced.element,
    h("div", { class: "submit" }, estimate, render),
  );
  // A field that is out of range must be seen to be mended.
  element.addEventListener("invalid", () => (advanced.element.open = true), { capture: true });
  update();
  return { element, update };
}

/**
 * @param {Scene} scene
 * @returns {{elements: HTMLElement[], get: () => Pick<JobRequest, "camera" | "view">}}
 */
function cameraFields({ cameras }) {
  const camera = h(
    "select",
    null,
    cameras.map(({ name }) =>
      h("option", { value: name }, name === AUTO_CAMERA ? "Automatic: frames the scene" : name),
    ),
    h("option", { value: OWN_VIEW }, "Custom view …"),
  );
  const view = viewFields(cameras[0]?.view);
  view.element.hidden = true;
  camera.addEventListener("change", () => {
    view.element.hidden = camera.value !== OWN_VIEW;
    const chosen = cameras.find(({ name }) => name === camera.value);
    if (chosen) view.set(chosen.view); // where a view of one's own then starts
  });
  return {
    elements: [field("Camera", camera), view.element],
    get: () => (camera.value === OWN_VIEW ? { view: view.get() } : { camera: camera.value }),
  };
}

/**
 * @param {Scene} scene
 * @param {{width: number, height: number}} size
 * @param {number} spp
 * @returns {string} a sentence
 */
function costOf(scene, { width, height }, spp) {
  const samples = width * height * spp;
  const all = workers.value ?? [];
  const slots = plural(
    all.reduce((sum, worker) => sum + worker.slots, 0),
    "slot",
  );
  const speed = expectedSpeed(all, jobs.value ?? [], scene.id);
  const cost = `${compact(samples)} samples`;
  if (!all.length) return `${cost}. They wait for a worker.`;
  if (!speed) return `${cost} on ${slots}. How long that takes is known once they have rendered something.`;
  return `${cost}, ${roughly(samples / speed)} on ${slots}`;
}
