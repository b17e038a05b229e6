/** The form of a picture's settings on a scene's page, with the expected cost. */

import { byProgram } from "../forms/by-program.js";
import { canDenoise } from "../job/denoise-fields.js";
import { isViewDenoised } from "./denoise-view.js";
import { fileField } from "./scene-notices.js";
import { cameraFields } from "../forms/camera-fields.js";
import { isLightless } from "../base/light-words.js";
import { fill, h, setText } from "../base/dom.js";
import { jobs, scenes, workers } from "../news/farm.js";
import { compact, noiseText } from "../base/format.js";
import { icon } from "../base/icons.js";
import { mayChange, readOnlyReason } from "../news/projects.js";
import { openMore } from "../forms/environment-fields.js";
import { qualityFields } from "../forms/quality-fields.js";
import { queueFold } from "../forms/queue-fold.js";
import { HeldMeasurement, expected, expectedText, rangeText } from "../forms/expected-time.js";
import { shotFields } from "../shot/shot-fields.js";
import { settingFields } from "../forms/setting-fields.js";
import { sizeFields } from "../forms/size-fields.js";
import { standFields } from "../forms/stand-fields.js";
import { variantField } from "../forms/variant-field.js";
import { withFold } from "../shell/layouts.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").JobRequest} JobRequest */
/** @typedef {import("./form-start.js").FormStart} FormStart */

/** Expected seconds from which a picture is marked as taking long. */
const LONG_S = 600;

/**
 * @typedef {object} SettingsForm
 * @property {HTMLFormElement} element
 * @property {() => void} update the farm's speed may have changed
 * @property {() => JobRequest} request as the form is now
 * @property {() => import("../base/types.js").View} view
 * @property {(view: import("../base/types.js").View) => void} turn to a view of the user's own, or of a camera or side
 * @property {(side: string) => import("../base/types.js").View | null} side returns the view that frames the scene from a side (forms/side-views.js)
 * @property {(start: FormStart) => void} restore shows other settings; goals of quality and the queue stay
 * @property {(distance: number) => void} focus
 * @property {(cost: number) => void} measure the live view has measured the seconds of a slot for a sample
 * @property {import("../forms/environment-fields.js").LightHandle} light
 * @property {(words: string, remedy: {word: string, run: () => void} | null) => void} setCaution says in place of the cost why the picture will show nothing; "": it will show something
 * @property {() => void} dispose
 */

/**
 * @param {Scene} scene ready, unless `waiting` is given
 * @param {(request: JobRequest) => Promise<void>} submit
 * @param {FormStart | null} [start] what the form shows first; null: what the scene file asks for
 * @param {boolean} [asShot] whether an animated scene is rendered as a shot by default
 * @param {HTMLElement | null} [waiting] shown in place of the cost while the scene is prepared; nothing can be chosen meanwhile
 * @returns {SettingsForm}
 */
export function settingsForm(scene, submit, start = null, asShot = false, waiting = null) {
  const { defaults } = scene;
  const estimate = h("p", { class: "quiet small number" });
  let update = () => {};
  /** What is wrong with the picture that the form would render. @type {{words: string, remedy: {word: string, run: () => void} | null}} */
  let caution = { words: "", remedy: null };
  const program = byProgram(() => request());
  /** The latest state of the scene, whose measurements are updated by each picture. */
  const known = () => scenes.value?.find(({ id }) => id === scene.id) ?? scene;
  const measurement = new HeldMeasurement();
  /** @param {number} spp */
  const expect = (spp) => {
    const { width, height } = parts.size.get();
    const isDenoised = clean.checked && !denoise.hidden && parts.shot.count() === 1; // the page denoises a shot's frames one by one
    return expected(known(), measurement, scenes.value ?? [], workers.value ?? [], { pixels: width * height * parts.shot.count(), spp, isDenoised });
  };
  /** The fields that show other settings when a take is restored. @param {FormStart | null} start */
  const build = (start) => {
    const first = start?.first ?? {};
    const shot = shotFields(scene, start?.shot ?? null, () => update(), asShot && !start);
    const size = sizeFields({ ...defaults, ...first }, () => update());
    const camera = cameraFields(scene, (projection) => size.suit(projection), () => stand.bounds());
    const others = settingFields(defaults, first, scene.light_groups ?? [], isLightless(scene), scene.id);
    const variant = variantField(scene, start?.variant ?? null);
    const stand = standFields(scene, start, (moved) => camera.move(moved(camera.view())));
    if (start?.view) camera.turn(start.view);
    else if (start) camera.choose(start.camera ?? 0);
    return { shot, size, camera, others, variant, stand };
  };
  let parts = build(start);
  let isDenoiseChosen = start !== null;
  const clean = h("input", { type: "checkbox", role: "switch", checked: Boolean(start?.denoise), onchange: () => ((isDenoiseChosen = true), update()) });
  const denoise = h("label", { class: "check" }, clean, t("Denoise"));
  const quality = qualityFields({ ...defaults, ...start?.first }, () => update(), expect);
  const queue = queueFold(start);
  const file = fileField(scene);
  update = () => {
    const { size, shot } = parts;
    denoise.hidden = !canDenoise(workers.value);
    if (!isDenoiseChosen) clean.checked = shot.count() === 1 && isViewDenoised(); // a still looks as the view does
    quality.update();
    const expectation = expect(quality.get());
    const { width, height } = size.get();
    if (!caution.words) setText(estimate, costWords(expectation));
    estimate.title = caution.words ? "" : detailWords(expectation, width * height * quality.get() * shot.count());
    estimate.classList.toggle("long", caution.words !== "" || (expectation.seconds ?? 0) > LONG_S);
  };
  /** @returns {JobRequest} */
  const request = () => ({
    scene: scene.id,
    ...parts.variant.get(),
    ...parts.stand.get(),
    ...parts.camera.get(),
    ...parts.size.get(),
    spp: quality.get(),
    ...(clean.checked && !denoise.hidden && { denoise: true }),
    ...parts.shot.get(),
    ...parts.others.get(),
    ...queue.get(),
  });
  const render = h("button", { class: "button primary large wide", type: "submit" }, icon("play"), t("Render"));
  const isFree = mayChange(scene.project);
  render.disabled = !isFree;
  const why = !isFree && h("p", { class: "hint", role: "note" }, readOnlyReason(scene.project));
  const onsubmit = async (/** @type {SubmitEvent} */ event) => {
    event.preventDefault();
    if (render.disabled) return; // the shortcut works even while the service has not answered
    if (!element.checkValidity()) {
      showFirstProblem(element);
      return;
    }
    render.disabled = true;
    try {
      await submit(request());
    } finally {
      render.disabled = false;
    }
  };
  // Scrolls to an opened section, which is often below the edge of the screen.
  const onclick = (/** @type {MouseEvent} */ { target }) => {
    const fold = /** @type {HTMLElement} */ (target).closest("summary")?.parentElement;
    requestAnimationFrame(() => fold?.hasAttribute("open") && fold.scrollIntoView({ block: "nearest" }));
  };
  const advanced = h("div", { class: "stack" });
  const fold = withFold("advanced", h("details", { class: "advanced" }, h("summary", null, t("Advanced")), advanced));
  const bottom = h("div", { class: "submit" }, waiting ?? estimate, why, render);
  const element = h("form", { class: "settings", "aria-label": t("Render settings"), noValidate: true, onsubmit, onclick });
  const arrange = () => {
    const { camera, variant, shot, others, stand, size } = parts;
    const [cameraField, ...ofCamera] = camera.elements;
    const first = file && cameraField ? h("div", { class: "pairs of-file" }, file, cameraField) : cameraField;
    const fields = [ofCamera, variant.elements, shot.elements, others.light, stand.elements, size.elements, quality.elements];
    fill(advanced, camera.lens, others.basic, others.advanced, queue.element, program.element);
    fill(element, first, fields.flat(), h("div", { class: "row wraps" }, denoise, others.groups), fold, bottom);
    update();
  };
  for (const type of ["input", "change"]) element.addEventListener(type, program.update);
  arrange();
  return {
    element,
    update,
    request,
    view: () => parts.camera.view(),
    turn: (view) => (parts.camera.turn(view), program.update()),
    side: (name) => parts.camera.side(name),
    restore(next) {
      const { others } = parts;
      parts = build(next);
      others.dispose();
      arrange();
      program.update();
    },
    focus: (distance) => parts.camera.focus(distance),
    measure(cost) {
      if (measurement.ofView === cost) return;
      measurement.ofView = cost;
      if (!measurement.held) update();
    },
    setCaution(words, remedy) {
      if (words === caution.words) return;
      caution = { words, remedy };
      render.classList.toggle("primary", !words); // with a caution, rendering is not the suggested action
      fill(estimate, words, remedy && " ", remedy && h("button", { class: "text-button", type: "button", onclick: remedy.run }, remedy.word));
      update();
    },
    light: {
      get: () => parts.others.lightHandle.get(),
      set: (...light) => parts.others.lightHandle.set(...light),
      sun: () => parts.others.lightHandle.sun(),
      stand: (...sun) => parts.others.lightHandle.stand(...sun),
      choose: (id) => parts.others.lightHandle.choose(id),
      keep: () => parts.others.lightHandle.keep(),
    },
    dispose: () => (parts.others.dispose(), queue.dispose()),
  };
}

/**
 * Makes the first invalid field visible.
 *
 * @param {HTMLFormElement} form
 */
function showFirstProblem(form) {
  const wrong = /** @type {HTMLElement | null} */ (form.querySelector("input:invalid"));
  for (let fold = wrong?.closest("details"); fold; fold = fold.parentElement?.closest("details")) fold.open = true;
  if (wrong?.closest(".light-rest")) openMore(wrong);
  wrong?.focus();
}

/** Returns how long a picture is expected to take, as a sentence; a blank line while that is unknown. @param {import("../forms/expected-time.js").Expectation} expectation */
function costWords({ seconds, isSure }) {
  const all = workers.value;
  if (!all) return ""; // not loaded yet
  if (!all.length) return t("It waits for a worker.");
  if (seconds === null) return "\u00a0";
  const isBusy = jobs.value?.some(({ state }) => state === "running");
  if (!isSure) {
    const time = rangeText(seconds);
    return isBusy ? t("Takes {time}, longer while another picture is rendered", { time }) : t("Takes {time}", { time });
  }
  const time = expectedText(seconds);
  return isBusy ? t("About {time}, longer while another picture is rendered", { time }) : t("About {time}", { time });
}

/** Returns what a picture's time depends on, and its noise. @param {{noise: number | null}} expectation @param {number} samples of the whole picture */
function detailWords({ noise }, samples) {
  const slots = (workers.value ?? []).reduce((sum, worker) => sum + worker.slots, 0);
  const parts = [t("{n} samples", { n: compact(samples) }), tn(slots, "{n} slot", "{n} slots"), noise !== null && t("{noise} noise", { noise: noiseText(noise) })];
  return parts.filter(Boolean).join(", ");
}
