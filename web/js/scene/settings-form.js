/** The form of a picture's settings on a scene's page, with the expected cost. */

import { byProgram } from "../forms/by-program.js";
import { canDenoise } from "../job/denoise-fields.js";
import { cameraFields } from "../forms/camera-fields.js";
import { isLightless } from "../base/light-words.js";
import { h, setText } from "../base/dom.js";
import { scenes, workers } from "../news/farm.js";
import { compact, noiseText, roughly } from "../base/format.js";
import { icon } from "../base/icons.js";
import { mayChange, readOnlyReason } from "../news/projects.js";
import { openMore } from "../forms/environment-fields.js";
import { qualityFields } from "../forms/quality-fields.js";
import { queueFold } from "../forms/queue-fold.js";
import { expected } from "../forms/render-presets.js";
import { shotFields } from "../shot/shot-fields.js";
import { settingFields } from "../forms/setting-fields.js";
import { sizeFields } from "../forms/size-fields.js";
import { standFields } from "../forms/stand-fields.js";
import { variantField } from "../forms/variant-field.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").JobRequest} JobRequest */

/** Expected seconds from which a picture is marked as taking long. */
const LONG_S = 600;

/**
 * @typedef {object} SettingsForm
 * @property {HTMLFormElement} element
 * @property {() => void} update the farm's speed may have changed
 * @property {() => JobRequest} request as the form is now
 * @property {() => import("../base/types.js").View} view
 * @property {(view: import("../base/types.js").View) => void} turn to a view of the user's own
 * @property {(distance: number) => void} focus
 * @property {import("../forms/environment-fields.js").LightHandle} light
 * @property {() => void} dispose
 */

/**
 * @param {Scene} scene ready
 * @param {(request: JobRequest) => Promise<void>} submit
 * @param {import("../base/types.js").Job | null} [like] an earlier job whose settings are the form's initial values
 * @param {boolean} [asShot] whether an animated scene is rendered as a shot by default
 * @returns {SettingsForm}
 */
export function settingsForm(scene, submit, like = null, asShot = false) {
  const { defaults } = scene;
  /** @type {Record<string, any>} */
  const first = like ? { ...like.settings, spp: like.spp, noise: like.noise, seconds: like.seconds, light: like.environment } : {};
  const estimate = h("p", { class: "quiet small number" });
  let update = () => {};
  const program = byProgram(() => request());
  const shot = shotFields(scene, like?.shot ?? null, () => update(), asShot && !like);
  /** The latest state of the scene, whose measurements are updated by each picture. */
  const known = () => scenes.value?.find(({ id }) => id === scene.id) ?? scene;
  /** @param {number} spp */
  const expect = (spp) => {
    const { width, height } = size.get();
    return expected(known(), workers.value ?? [], width * height * shot.count(), spp);
  };
  update = () => {
    quality.update();
    const expectation = expect(quality.get());
    setText(estimate, costOf(size.get(), quality.get(), shot.count(), expectation));
    denoise.hidden = !canDenoise(workers.value);
    estimate.classList.toggle("long", (expectation.seconds ?? 0) > LONG_S);
  };
  const size = sizeFields({ ...defaults, ...first }, () => update());
  const camera = cameraFields(scene, (projection) => size.suit(projection));
  const quality = qualityFields({ ...defaults, ...first }, () => update(), expect);
  const others = settingFields(defaults, first, scene.light_groups ?? [], isLightless(scene));
  const variant = variantField(scene, like?.variant ?? null);
  const clean = h("input", { type: "checkbox", role: "switch", checked: Boolean(like?.denoise) });
  const denoise = h("label", { class: "check" }, clean, t("Denoise"));
  const stand = standFields(scene, like, (moved) => camera.move(moved(camera.view())));
  const queue = queueFold(like);
  // Not for a shot, whose camera may be animated, while a custom view is static.
  if (like?.settings && !like.shot) camera.turn(like.settings.view);
  /** @returns {JobRequest} */
  const request = () => ({
    scene: scene.id,
    ...variant.get(),
    ...stand.get(),
    ...camera.get(),
    ...size.get(),
    spp: quality.get(),
    ...(clean.checked && !denoise.hidden && { denoise: true }),
    ...shot.get(),
    ...others.get(),
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
  const element = h(
    "form",
    { class: "settings", "aria-label": t("Render settings"), noValidate: true, onsubmit, onclick },
    camera.elements,
    variant.elements,
    shot.elements,
    others.light,
    stand.elements,
    size.elements,
    quality.elements,
    denoise,
    h(
      "details",
      { class: "advanced" },
      h("summary", null, t("Advanced")),
      h("div", { class: "stack" }, camera.lens, others.basic, others.advanced, queue.element, program.element),
    ),
    h("div", { class: "submit" }, estimate, why, render),
  );
  for (const type of ["input", "change"]) element.addEventListener(type, program.update);
  update();
  /** @param {import("../base/types.js").View} view */
  const turn = (view) => (camera.turn(view), program.update());
  return { element, update, request, view: camera.view, turn, focus: camera.focus, light: others.lightHandle, dispose: () => (others.dispose(), queue.dispose()) };
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

/**
 * @param {{width: number, height: number}} size
 * @param {number} spp
 * @param {number} frames
 * @param {{seconds: number | null, noise: number | null}} expectation
 * @returns {string} a sentence
 */
function costOf({ width, height }, spp, frames, { seconds, noise }) {
  const all = workers.value ?? [];
  const slots = tn(
    all.reduce((sum, worker) => sum + worker.slots, 0),
    "{n} slot",
    "{n} slots",
  );
  const cost = t("{n} samples", { n: compact(width * height * spp * frames) });
  if (!all.length) return t("{cost}. They wait for a worker.", { cost });
  if (seconds === null) return t("{cost} on {slots}. How long that takes is known once they have rendered something.", { cost, slots });
  return t("{cost}, {time} on {slots}", { cost, time: roughly(seconds), slots }) + (noise === null ? "" : `, ${t("{noise} noise", { noise: noiseText(noise) })}`);
}
