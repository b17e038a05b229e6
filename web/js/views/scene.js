/** The page of a scene: being prepared, failed, or ready to render. */

import { examplePictures } from "../news/example-pictures.js";
import { createJob, getScene, imageUrl, posterUrl, thumbnailFormat, thumbnailUrl } from "../news/api.js";
import { WITHOUT_LIGHT } from "../base/codes.js";
import { fill, h, setFacts, setText } from "../base/dom.js";
import { adoptJob, adoptScene, jobs, putScene, scenes, workers } from "../news/farm.js";
import { bytes, count, extent } from "../base/format.js";
import { emptyPage, noWorkerNotice } from "../shell/hints.js";
import { icon } from "../base/icons.js";
import { go, here, linkTo, setParams, setTitle } from "../shell/router.js";
import { returnToPlace } from "../shell/scroll-memory.js";
import { sideEdge } from "../shell/layouts.js";
import { offer } from "../news/projects.js";
import { failedScene } from "../scene/failed-scene.js";
import { startOfJob } from "../scene/form-start.js";
import { settingsForm } from "../scene/settings-form.js";
import { homeCamera } from "../forms/camera-fields.js";
import { START } from "../forms/view-fields.js";
import { keepFirstLook, prepareLook } from "../film/first-look.js";
import { firstFrame } from "../base/shot-words.js";
import { knowExamples } from "../shell/examples.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { progressBar, stateChip } from "../shell/state-chip.js";
import { Disposer } from "../base/store.js";
import { announce, showError } from "../shell/tray.js";
import { clampExposure, lookFromUrl } from "../job/display-panel.js";
import { cardPicture, jobLook, lookOfJob } from "../film/job-look.js";
import { PREPARING } from "../scene/clarity.js";
import { beginView } from "../scene/mesh-relay.js";
import { liveView } from "../scene/live-view.js";
import { shapeView } from "../scene/view-request.js";
import { viewFromText, viewToText } from "../scene/view-url.js";
import { prepareSteps, stepOf } from "../scene/prepare-steps.js";
import { preparingView } from "../scene/preparing-view.js";
import { meshOf, takeTurned } from "../scene/preview-mesh.js";
import { renderStrip } from "../scene/render-strip.js";
import { invisibleWords, stepWords, warnings } from "../scene/scene-notices.js";
import { sidesFromUrl } from "../scene/sides.js";
import { sideNames } from "../compare/job-differences.js";
import { removeScene } from "./scene-card.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").Job} Job */

/**
 * @param {string} id
 * @returns {{element: HTMLElement, dispose: () => void}}
 */
export function sceneView(id) {
  setTitle(t("Scene"));
  const life = new Disposer();
  const element = h("div", { class: "page scene-page" });
  /** @param {Error & {status?: number}} error */
  const gone = ({ message, status }) =>
    fill(
      element,
      emptyPage("cube", t("This scene is not here"), h("p", null, status === 404 ? t("It was deleted, or its address is incomplete.") : message), h("a", { href: linkTo() }, t("To the scenes"))),
    );

  let asked = false;
  /** Whether the page has been drawn. */
  let isDrawn = false;
  /** @type {{status: string, update: (scene: Scene) => void} | null} */
  let part = null;
  const own = new Disposer(); // of the part
  /** The steps of an upload, until its first picture. */
  const steps = prepareSteps(id);
  let isOpen = true;
  life.add(() => (own.dispose(), (part = null), (isOpen = false)));
  const follow = () =>
    scenes.subscribe((all) => {
      const scene = all?.find((candidate) => candidate.id === id);
      if (scene) {
        if (part?.status !== scene.status) {
          if (part && scene.status === "ready") {
            announce(t("{name} is ready to render", { name: scene.name }));
            if (scene.preview) meshOf(id).catch(() => {}); // fetched while the view is built, which asks for it
          }
          offer(element, scene.project);
          own.dispose();
          const isFirst = part === null;
          const mine = (part = { status: scene.status, update: (/** @type {Scene} */ _) => {} });
          const open = () => (mine.update = { preparing, failed, ready }[scene.status](element, scene, own, steps));
          if (isFirst) beginView(() => (isDrawn = true));
          // A view that takes the graphics card for seconds must not hold up the page: its outline is drawn first.
          if (!isDrawn && scene.status === "ready") {
            element.classList.add("workspace");
            own.add(() => element.classList.remove("workspace"));
            fill(element, heading(scene), outline(scene, own, steps));
            beginView(() => part === mine && (own.dispose(), open()));
          } else open();
        }
        part.update(scene);
        setTitle(scene.name);
      } else if (all && !asked) {
        asked = true; // the list may be older than the scene
        getScene(id).then(adoptScene, gone);
      }
    });
  // The picture of an example, of many samples, is shown instead of a poster; both lists arrive at the same time.
  const known = knowExamples();
  if (scenes.value) life.add(follow());
  else void known.then(() => isOpen && life.add(follow()));
  return { element, dispose: () => life.dispose() };
}

/** Largest relative difference of two aspect ratios that counts as none. */
const SAME_SHAPE = 0.01;

/** @param {Scene} scene */
function heading(scene) {
  return h(
    "header",
    { class: "scene-head" },
    h("a", { class: "icon-button", href: linkTo(), "aria-label": t("All scenes"), title: t("All scenes"), onclick: returnToPlace }, icon("back")),
    h("h1", { title: scene.name }, scene.name),
    h(
      "button",
      {
        class: "icon-button danger for-submit",
        type: "button",
        "aria-label": t("Delete this scene"),
        title: t("Delete this scene"),
        onclick: () => (removeScene(scene), go()),
      },
      icon("trash"),
    ),
  );
}

/** The form of a scene that is not shown yet, in which nothing can be chosen. @param {Scene} scene @param {Disposer} life @param {HTMLElement | null} status in place of the cost */
function waitingSide(scene, life, status) {
  const form = settingsForm(scene, async () => {}, null, false, status);
  life.add(form.dispose);
  const isUnknown = scene.status === "preparing" && SETTINGS_FILE.test(scene.main ?? "");
  return h(
    "div",
    { class: "workspace-side" },
    scene.status === "ready" && warnings(scene),
    h("section", { class: "panel", "aria-label": t("Render") }, h("fieldset", { class: `not-yet ${isUnknown ? "unknown" : ""}`, disabled: true }, form.element)),
  );
}

/** A scene's page before its view: its poster or thumbnail, unless another view is asked for, and the steps of an upload. @param {Scene} scene @param {Disposer} life @param {Steps} steps */
function outline(scene, life, steps) {
  const { id, thumbnail, defaults } = scene;
  const surface = h("div", { class: "live-view" });
  const isOwnView = !["view", "like", "light"].some((name) => here().params.has(name));
  const url = examplePictures.get(id) || posterUrl(scene) || (thumbnail ? thumbnailUrl(id) : "");
  if (url && isOwnView) surface.style.backgroundImage = `url("${url}")`;
  if (steps.isOpen) steps.render();
  const nothing = invisibleWords(scene);
  const pills = h(
    "div",
    { class: "view-pills" },
    h("p", { class: "small view-state" }, steps.line || PREPARING),
    steps.isOpen && steps.element,
    nothing && h("div", { class: "view-dark" }, h("span", null, nothing)),
  );
  const frame = h("div", { class: "live-view-frame" }, surface, pills);
  shapeView(frame, (defaults["width"] ?? 16) / (defaults["height"] ?? 9));
  return h(
    "div",
    { class: "workspace-columns" },
    h("div", { class: "workspace-view" }, h("div", { class: "workspace-top" }, h("div", { class: "live-view-box" }, frame))),
    waitingSide(scene, life, null),
  );
}

/** @typedef {ReturnType<typeof prepareSteps>} Steps */

/**
 * @param {HTMLElement} page
 * @param {Scene} scene
 * @param {Disposer} life
 * @param {Steps} steps
 * @returns {(scene: Scene) => void}
 */
function preparing(page, scene, life, steps) {
  const chip = stateChip("preparing");
  const step = h("p", { class: "quiet small", "aria-live": "polite" });
  const bar = progressBar(t("Preparing"));
  const notice = h("div", { class: "notice-slot" });
  const view = preparingView(scene, steps);
  const status = h("section", { class: "preparing-panel", "aria-label": t("Preparing") }, chip.element, bar.element, step);
  page.classList.add("workspace");
  life.add(() => page.classList.remove("workspace"));
  life.add(view.dispose);
  life.add(workers.subscribe((all) => fill(notice, all?.length === 0 && noWorkerNotice())));
  life.every(200, steps.tick);
  askForPreview(scene, life);
  fill(
    page,
    heading(scene),
    notice,
    h(
      "div",
      { class: "workspace-columns" },
      h("div", { class: "workspace-view" }, h("div", { class: "workspace-top" }, view.element)),
      waitingSide(draftOf(scene), life, status),
    ),
  );
  return (next) => {
    steps.update(next);
    const words = steps.word ? `${steps.word} …` : stepWords(next); // one word for a step, here and in the list
    setText(step, words);
    bar.update(stepOf(next) === "read" ? null : next.progress); // how much is left to read is not known
    view.update(next, words);
  };
}

/** Files that state the settings of their picture, which are not known until they are read. */
const SETTINGS_FILE = /\.ya?ml$/i;
/** Files that state no up axis (renderer/scene/readers/up_axis.py), and those that have no lights, or seldom. */
const MESH_FILE = /\.(obj|ply|stl)$/i;
const UNLIT_FILE = /\.(obj|ply|stl|off|3mf|glb|gltf|usdz)$/i;

/** Returns what the form shows until the scene is known: the automatic camera, the studio's light, and of a mesh file its guessed axis. @param {Scene} scene @returns {Scene} */
function draftOf(scene) {
  const cameras = scene.cameras.length ? scene.cameras : [{ name: "auto", view: START }];
  const isUnlit = UNLIT_FILE.test(scene.main ?? "") && !scene.environment;
  const codes = { ...scene.codes, warnings: [{ code: WITHOUT_LIGHT, params: {} }] };
  return { ...scene, cameras, ...(isUnlit && { codes }), ...(MESH_FILE.test(scene.main ?? "") && { up_axis: "y", up: scene.up ?? "auto" }) };
}

/** Interval and maximum duration, in milliseconds, of polling for a preview, since events come only twice a second. */
const [ASK_MS, ASKED_MS] = [150, 5000];

/** Asks for a scene's state until it has a preview. @param {Scene} scene @param {Disposer} life */
function askForPreview({ id }, life) {
  const until = performance.now() + ASKED_MS;
  let isAsking = false;
  const lacksPreview = () => scenes.value?.some((known) => known.id === id && known.status === "preparing" && !known.preview);
  life.every(ASK_MS, async () => {
    if (isAsking || !lacksPreview() || performance.now() > until) return;
    isAsking = true;
    await getScene(id).then(
      (next) => next.preview && lacksPreview() && putScene(next), // unless an event that is newer has come meanwhile
      () => {}, // the events report the change
    );
    isAsking = false;
  });
}

/**
 * @param {HTMLElement} page
 * @param {Scene} scene
 * @param {Disposer} life
 * @returns {(scene: Scene) => void}
 */
function failed(page, scene, life) {
  page.classList.add("workspace");
  life.add(() => page.classList.remove("workspace"));
  fill(page, heading(scene), failedScene(scene, () => (removeScene(scene), go())));
  return () => {};
}

/**
 * The workspace of a ready scene: the view, the settings, and the pictures.
 *
 * @param {HTMLElement} page
 * @param {Scene} scene
 * @param {Disposer} life
 * @param {Steps} steps
 * @returns {(scene: Scene) => void}
 */
function ready(page, scene, life, steps) {
  const path = here().path.join();
  const notice = h("div", { class: "notice-slot" });
  let isStarting = false; // the page stays as it is until the job's is shown
  const submit = async (/** @type {import("../base/types.js").JobRequest} */ request) => {
    isStarting = true;
    void import("./job.js");
    try {
      const { exposure, curve } = view.look();
      const look = lookOfJob({ exposure: clampExposure(exposure), tonemap: curve });
      // One key per click, so that a repeated request creates only one job.
      const job = await createJob({ ...request, ...look }, crypto.randomUUID?.() ?? String(Math.random()));
      const first = { ...view.firstLook(), place: view.element.querySelector(".live-view")?.getBoundingClientRect() };
      await prepareLook(first);
      keepFirstLook(job.id, first);
      adoptJob(job);
      if (here().path.join() !== path) return; // the user has left the page meanwhile
      location.hash = linkTo("jobs", job.id);
      await new Promise((resolve) => life.add(() => resolve(null))); // the form is not for another job until the page is left
    } catch (error) {
      isStarting = false;
      showError(t("The job could not be started"), error);
    }
  };
  const like = (jobs.value ?? []).find(({ id }) => id === here().params.get("like")) ?? null;
  const form = settingsForm(scene, submit, like && startOfJob(like), here().params.has("shot"));
  life.add(form.dispose);
  if (here().params.get("light") === "studio") {
    setParams({ light: null }); // the choice is the form's from now on
    form.light.choose("studio");
  }
  life.add(workers.subscribe((all) => (fill(notice, all?.length === 0 && noWorkerNotice()), form.update())));
  life.add(jobs.subscribe(() => form.update()));
  life.add(
    addShortcuts([
      { keys: "R", shown: "R, Enter", does: t("Render"), run: () => form.element.requestSubmit() },
      { keys: "Enter", shown: null, does: t("Render"), run: () => form.element.requestSubmit() },
    ], "picture"),
  );
  const sides = sidesFromUrl(life);
  if (steps.isOpen) life.every(200, () => steps.isOpen && steps.render());
  const view = viewOf(scene, form, sides, life, steps);
  if (like) view.setLook(lookFromUrl(here().params, jobLook(like)));
  const side = h(
    "div",
    { class: "workspace-side" },
    warnings(scene), // above the view, they would move it
    h("section", { class: "panel", "aria-label": t("Render") }, form.element),
  );
  page.classList.add("workspace");
  life.add(() => page.classList.remove("workspace"));
  fill(
    page,
    heading(scene),
    notice,
    h(
      "div",
      { class: "workspace-columns" },
      h(
        "div",
        { class: "workspace-view" },
        h("div", { class: "workspace-top" }, view.element),
        h("div", { class: "strips" }, view.takes, renderStrip(scene.id, sides, life, () => isStarting)),
        facts(scene),
      ),
      side,
      sideEdge(() => side, life),
    ),
  );
  return () => {};
}

/**
 * The live view, synchronised with the form and the URL's `view`.
 *
 * @param {Scene} scene
 * @param {import("../scene/settings-form.js").SettingsForm} form
 * @param {import("../base/store.js").Store<import("../scene/sides.js").Sides>} sides
 * @param {Disposer} life
 * @param {Steps} steps
 */
function viewOf(scene, form, sides, life, steps) {
  const home = homeCamera(scene.cameras);
  let written = here().params.get("view");
  const linked = viewFromText(written) ?? takeTurned(scene.id);
  if (linked) form.turn(linked);
  // Of the same view and in the same light: a picture of another one would jump when the samples come.
  const { background = "visible", environment, floor, up, variant, frames, width: wide = 1, height: tall = 1 } = form.request();
  const isSeen = (/** @type {Job} */ { scene: of, state, settings, environment: light, floor: on, width, height }) =>
    of === scene.id && state === "finished" && Math.abs(((width ?? 0) * tall) / ((height ?? 1) * wide) - 1) < SAME_SHAPE && settings !== null && viewToText(settings.view) === viewToText(form.view()) && (settings["background"] ?? "visible") === background && !light && !environment && JSON.stringify(on ?? null) === JSON.stringify(floor ?? null);
  const finished = (jobs.value ?? []).find(isSeen);
  const example = linked ? undefined : examplePictures.get(scene.id); // shown while the scene was prepared
  const picture = finished && imageUrl({ job: finished.id, frame: firstFrame(finished) }, thumbnailFormat(finished), { width: 800, visible: "true", v: finished.samples });
  const isUsual = !linked && !here().params.has("like") && background === "visible" && !environment && floor == null && up == null && variant == null && !frames;
  // An example's picture, of many samples, is clearer than the poster of a view that was open for a moment.
  const clear = isUsual ? example || posterUrl(scene) : "";
  const best = clear || picture || example;
  // A card has shown it. With another exposure than the view's it would be another picture.
  const smaller = finished && Object.keys(lookOfJob(finished)).length === 0 ? cardPicture(finished) : undefined;
  const seen = { url: best ?? (scene.thumbnail ? thumbnailUrl(scene.id) : ""), nearest: smaller ?? "", isFinished: best !== undefined, isSame: !linked && !here().params.has("like"), isClear: clear !== "", steps };

  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const path = here().path.join();
  const write = () => {
    // Browsers throttle history changes; a moving pointer makes sixty per second.
    timer ??= setTimeout(() => {
      timer = undefined;
      // An address that changed meanwhile wins; its `hashchange` event may still be queued behind this timer.
      if (here().path.join() !== path || here().params.get("view") !== written) return;
      const { view, camera } = form.request();
      const isFirst = camera === undefined || camera === home || camera === scene.cameras[home]?.name;
      written = view || !isFirst ? viewToText(view ?? form.view()) : null;
      setParams({ view: written });
    }, 400);
  };
  const names = (/** @type {Job} */ a, /** @type {Job} */ b) => sideNames({ job: a, channel: "" }, { job: b, channel: "" });
  const live = liveView(scene, form, seen, write, sides, names);
  const changed = () => (live.refresh(), write());
  form.element.addEventListener("change", changed);
  form.element.addEventListener("input", live.refresh);
  const follow = () => {
    if (here().path.join() !== path) return;
    const text = here().params.get("view");
    const view = viewFromText(text);
    if (text === written || !view) return;
    written = text;
    form.turn(view);
    live.refresh();
  };
  addEventListener("hashchange", follow);
  life.add(() => {
    clearTimeout(timer);
    removeEventListener("hashchange", follow);
    live.dispose();
  });
  return live;
}

/** Labels of the service's counts of a scene. @type {Record<string, string>} */
const COUNTED = {
  triangles: t("Triangles"),
  unique_triangles: t("Unique triangles"),
  vertices: t("Vertices"),
  spheres: t("Spheres"),
  meshes: t("Meshes"),
  instances: t("Instances"),
  materials: t("Materials"),
  textures: t("Textures"),
  lights: t("Lights"),
};

/** A line about a scene's size, which opens a table of all counts. @param {Scene} scene */
function facts(scene) {
  const { triangles = 0, unique_triangles: unique = 0, spheres = 0, textures = 0 } = scene.counts;
  /** @type {[string, string][]} */
  const rows = Object.entries(scene.counts)
    .filter(([name, n]) => n > 0 && !(name === "unique_triangles" && unique === triangles))
    .map(([name, n]) => [COUNTED[name] ?? name, count(n)]);
  if (scene.cameras.length > 1) rows.push([t("Cameras"), count(scene.cameras.length - 1)]); // without the automatic one
  const end = Math.max(0, ...(scene.clips ?? []).map((clip) => clip.end));
  if (end) rows.push([t("Animation"), t("{n} s at {fps} fps", { n: Number(end.toFixed(2)), fps: scene.fps ?? "" })]);
  if ((scene.clips?.length ?? 0) > 1) rows.push([t("Clips"), count(scene.clips?.length ?? 0)]);
  const [lo, hi] = scene.bounds ?? [];
  if (lo && hi) rows.push([t("Extent"), extent(hi.map((v, i) => v - (lo[i] ?? 0)))]);
  rows.push([t("Files"), bytes(scene.bytes)]);
  const line = h("span", { class: "facts-line" });
  setFacts(line, [
    ...(triangles ? [triangles === 1 ? t("1 triangle") : t("{n} triangles", { n: count(triangles) })] : []),
    ...(spheres ? [tn(spheres, "{n} sphere", "{n} spheres")] : []),
    ...(textures ? [tn(textures, "{n} texture", "{n} textures")] : []),
    bytes(scene.bytes),
  ]);
  return h(
    "details",
    {
      class: "scene-facts small number",
      ontoggle: (/** @type {Event} */ { currentTarget }) => currentTarget instanceof HTMLDetailsElement && currentTarget.open && currentTarget.scrollIntoView({ block: "end", behavior: "smooth" }),
    },
    h("summary", null, line),
    h("dl", { class: "facts tiles" }, rows.map(([name, value]) => h("div", null, h("dt", null, name), h("dd", null, value)))),
  );
}
