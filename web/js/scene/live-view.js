/**
 * The live view of a scene: the farm renders the form's current request while the user navigates. It is not a job, and nothing
 * is stored.
 */

import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { CannotShow, FilmCanvas } from "../film/film-canvas.js";
import { Film } from "../film/film.js";
import { autoExposure, darkness } from "../film/darkness.js";
import { curveOptions } from "../film/curves.js";
import { DEFAULT_CURVE } from "../film/tonemap.js";
import { Viewport } from "../film/viewport.js";
import { stops } from "../base/format.js";
import { parseFrames } from "../base/frame-numbers.js";
import { PLACE_SUN } from "../forms/environment-fields.js";
import { addPart } from "../shell/layouts.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { heldKey, lightHand } from "./light-hand.js";
import { clarity, clarityField } from "./clarity.js";
import { clearView, keepClearView } from "./clear-views.js";
import { takeMesh } from "./mesh-relay.js";
import { people } from "./people.js";
import { probe } from "./probe.js";
import { denoiseView } from "./denoise-view.js";
import { alongSight, lookAt } from "./orbit.js";
import { examplePictures } from "../news/example-pictures.js";
import { localMeshOf } from "../news/local-mesh.js";
import { hasMesh, meshOf } from "./preview-mesh.js";
import { LIVE } from "./sides.js";
import { startOfTake } from "./form-start.js";
import { sunHand } from "./sun-hand.js";
import { takes } from "./takes.js";
import { viewHand } from "./view-hand.js";
import { viewMore } from "./view-more.js";
import { ViewFilm } from "./view-film.js";
import { ViewLink } from "./view-link.js";
import { viewStage } from "./view-stage.js";
import { viewTools } from "./view-tools.js";
import { Store } from "../base/store.js";
import { saidOf } from "../base/said.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("./view-link.js").Picked} Picked */

/** Maximum number of pixels rendered, whatever the screen's size; and where graphics cards make drafts. */
const [MOST_PIXELS, MOST_PIXELS_OF_CARDS] = [1 << 20, 1 << 21];
const LEAST_SIDE = 16;
/** Longer sides, in pixels, of a take's picture, and of the one that is shown when the view is opened again. */
const [TAKE_SIDE, CLEAR_SIDE] = [320, 1280];
/** Interval, in milliseconds, of checks whether the view is too dark; and by how many stops it has to be so for an offer. */
const [DARKNESS_MS, DULL_STOPS] = [500, 2];
/** Samples per pixel after which a view that is never denoised replaces a finished picture; and the preview mesh. */
const [CLEAN_SPP, MESH_SPP] = [8, 1];
/** Time, in milliseconds, that a view of MESH_SPP samples is awaited denoised, less where what is shown has another light, and samples per pixel that end the wait: noise must not follow a clean picture. */
const [DENOISED_MS, RELIT_MS, DENOISED_SPP] = [15_000, 2000, 64];
/** Time, in milliseconds, after which what lies under the first picture is removed: it has been drawn and faded in. */
const COVERED_MS = 500;
/** Samples per pixel from which a black view is explained: with fewer, light of few paths may not have been found. */
const BLACK_SPP = 4;
/** Part of the view's width that a denoised picture must have to replace the preview mesh; the number of requests whose cameras are remembered. */
const [FINE_SHARE, MOST_VIEWS] = [0.75, 256];
/** Samples per pixel after which a denoised view replaces the preview mesh, which is sharper than fewer denoised ones. */
const SHARP_SPP = 4;
/** Distance of the cameras, of 1, from which the kept picture shows little of the view. */
const POOR = 0.6;
/** Request fields that do not apply to a view. */
const JOB_ONLY_FIELDS = ["denoise", "fresh", "spp", "noise", "seconds", "frames", "order", "every", "name", "priority", "tile_size", "scene"];

/** Listed in the help; the view handles them while it has focus. */
const HAND_KEYS = [
  { keys: "W A S D Q E", does: t("In the view: fly; with Shift faster") },
  { keys: t("Arrows"), does: t("In the view: turn it; with Shift move it") },
  { keys: "− +", does: t("In the view: nearer and farther") },
];

/**
 * @param {import("../base/types.js").Scene} scene
 * @param {import("./settings-form.js").SettingsForm} form
 * @param {{url: string, nearest: string, isFinished: boolean, isSame: boolean}} meanwhile a picture to show until the view's first picture arrives; "" for
 *   none. One that is finished, or of the same view as a denoised one that comes, stays until the view is denoised or has some samples per pixel,
 *   or something else is asked for. nearest: the same, smaller, which the page has loaded before
 * @param {(view: View) => void} turned called when the user moves the camera
 * @param {import("../base/store.js").Store<import("./sides.js").Sides>} sides the pictures shown in place of the live view
 * @param {(a: Job, b: Job) => [string, string]} names of two pictures, made of their differences
 * @returns {{element: HTMLElement, takes: HTMLElement | null, refresh: () => void, dispose: () => void, look: () => {exposure: number, curve: string}, firstLook: () => import("../film/first-look.js").FirstLook}}
 *   firstLook: what a job that is started now shows first. takes: the strip of the scene's takes. refresh: requests a new view after a change of the form
 */
export function liveView(scene, form, meanwhile, turned, sides, names) {
  const canvas = h("canvas", { role: "img", "aria-label": t("The scene as it is seen now") });
  const over = h("canvas", { hidden: true });
  const mesh = takeMesh(scene.id);
  const meshed = mesh.canvas;
  meshed.ariaHidden = "true";
  meshed.hidden = true;
  const surface = h(
    "div",
    {
      class: "live-view",
      tabindex: "0",
      role: "application",
      "aria-label":
        t("The view. Arrows turn it, Shift and arrows move it, plus and minus go nearer and farther; W, A, S, D, Q and E fly."),
    },
    meshed,
    canvas,
    over,
  );
  const state = h("p", { class: "small quiet number view-state", role: "status", "aria-live": "off" });
  const said = h("p", { class: "small quiet view-hint" });
  const exposure = h("input", { class: "centred", type: "range", step: 0.25, "aria-label": t("Exposure in stops") });
  showExposure(exposure, 0);
  const curve = h(
    "select",
    { "aria-label": t("Tone curve") },
    curveOptions(DEFAULT_CURVE),
  );
  const shown = h("span", { class: "small number quiet" }, `${stops(0)} EV`);
  const auto = h(
    "button",
    { class: "button small", type: "button", title: t("Auto exposure (N)"), "aria-label": t("Auto exposure"), onclick: () => exposeAuto() },
    icon("exposure"),
    h("span", { class: "view-word" }, t("Auto")),
  );
  const clear = clarityField(() => refresh());
  const denoise = denoiseView(() => refresh());
  const willBeDenoised = () => denoise.isOn() && form.request().background !== "transparent"; // the denoiser makes no alpha
  const viewport = new Viewport();
  /** @type {FilmCanvas} */
  let picture;
  try {
    picture = new FilmCanvas(canvas, over, viewport);
  } catch (error) {
    if (!(error instanceof CannotShow)) throw error;
    mesh.dispose();
    return { element: h("p", { class: "notice" }, error.message), takes: null, refresh: () => {}, dispose: () => {}, look: () => ({ exposure: 0, curve: DEFAULT_CURVE }), firstLook: () => ({ film: new Film(1, 1), isSame: false, clean: "" }) };
  }
  /** The fields of the form's request that a view reads. */
  const viewRequest = () => {
    /** @type {Record<string, any>} */
    const request = { ...form.request() };
    if (request.frames) request.frame = firstOf(request.frames);
    for (const name of JOB_ONLY_FIELDS) delete request[name];
    return request;
  };
  // A previous picture of the scene, or its preview mesh, until the first samples arrive.
  const known = clearView(scene.id, JSON.stringify(viewRequest()));
  if (known) meanwhile = { url: known, nearest: "", isFinished: true, isSame: true };
  mesh.setScene(scene);
  let isSampled = false;
  const showMesh = () => {
    if (isSampled || !scene.preview) return;
    /** @param {import("../news/mesh-packet.js").MeshPacket} packet */
    const show = (packet) => {
      if (isSampled || isDisposed || mesh.mesh === packet) return;
      mesh.setMesh(packet);
      mesh.setView(form.view());
      meshed.hidden = false;
      surface.style.backgroundImage = "";
      canvas.classList.add("held-back"); // the first samples are coarser than the mesh
    };
    // What was drawn while the scene was prepared is here at once.
    void localMeshOf(scene.id).then((local) => local && !mesh.mesh && show(local.packet));
    meshOf(scene.id).then(show, () => {}); // the samples come without it
  };
  // A thumbnail is coarse at the view's size: the mesh replaces it.
  const hasMeshFirst = !meanwhile.url || (!meanwhile.isFinished && scene.preview) || (!known && hasMesh(scene.id) && meanwhile.url !== examplePictures.get(scene.id));
  let isDisposed = false;
  if (hasMeshFirst) showMesh();
  canvas.classList.toggle("held-back", !hasMeshFirst && (meanwhile.isFinished || (meanwhile.isSame && denoise.request().denoise)));
  const release = () => {
    canvas.classList.remove("held-back");
    if (isSampled) uncoverSoon();
  };
  const hasAlpha = meanwhile.url.includes("/image.png"); // as thumbnailFormat asks for a transparent background
  surface.classList.toggle("has-alpha", hasAlpha);
  const below = [meanwhile.url, meanwhile.nearest].filter(Boolean).map((url) => `url("${url}")`);
  if (hasAlpha) below.push("var(--squares-image)");
  surface.style.backgroundImage = below.join(", ");
  /** Shows the mesh that was drawn while the scene was prepared. */
  const showPassedMesh = () => {
    if (isSampled || !mesh.mesh) return;
    mesh.setView(form.view());
    meshed.hidden = false;
    surface.style.backgroundImage = "";
    canvas.classList.add("held-back"); // the first samples are coarser than the mesh
  };
  if (hasMeshFirst) showPassedMesh();
  /** Removes what is shown until samples come, once they cover it. */
  const uncover = () => {
    uncovering = undefined;
    if (canvas.classList.contains("held-back")) return;
    if (Number(getComputedStyle(canvas).opacity) < 1) return uncoverSoon(); // a busy machine fades late
    isCovered = false;
    surface.style.backgroundImage = "";
    meshed.hidden = true;
    mesh.release();
  };
  /** Loads the mesh for the next turn of the camera, if the view began with a picture instead. */
  const loadMesh = () => {
    if (mesh.mesh || !scene.preview || isDisposed) return;
    meshOf(scene.id).then((packet) => isDisposed || mesh.mesh || mesh.setMesh(packet), () => {});
  };
  let isCovered = true;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let uncovering;
  const uncoverSoon = () => void (isCovered && (uncovering ??= setTimeout(uncover, COVERED_MS)));

  /** Cameras of the latest requests, by their ids. @type {Map<number, View>} */
  const views = new Map();
  /** Camera of the request that is sent next. */
  let askedView = form.view();
  /** Lights of the latest requests, by their ids. @type {Map<number, string>} */
  const lights = new Map();
  /** Light of the request that is sent next, and of the kept picture. */
  let [askedLight, keptLight] = ["", ""];
  /** Shows the canvas's picture, projected for the camera, until another is clear. @param {View} view its camera */
  const keep = (view) => {
    mesh.keep(canvas, view);
    keptLight = lights.get(Number(surface.dataset.view)) ?? askedLight;
  };
  /** Keeps a denoised picture on the page after a change, projected for the new camera, until the new one is denoised. */
  const hold = () => {
    const view = views.get(Number(surface.dataset.view));
    const isClean = surface.dataset.denoised === "true" && film.film.isDenoised && !canvas.classList.contains("held-back");
    if (!view || !isClean || !willBeDenoised() || !mesh.mesh || !canKeep(view, form.view())) return;
    clearTimeout(uncovering);
    uncovering = undefined;
    isCovered = true;
    meshed.hidden = false;
    mesh.setView(form.view());
    picture.draw(); // WebGL keeps its picture only until the next frame
    keep(view);
    canvas.classList.add("held-back");
  };
  /**
   * Projects a denoised picture of an earlier request in place of the kept one, where it is better: in another light of the same camera,
   * or if the kept one shows little of the view.
   *
   * @param {number | null} id of the request
   */
  const keepNewer = (id) => {
    const view = views.get(id ?? 0);
    const isHeld = mesh.kept !== null && !meshed.hidden && canvas.classList.contains("held-back");
    if (!view || !isHeld || !canKeep(view, form.view())) return;
    if (mesh.distance === 0 ? JSON.stringify(view) !== JSON.stringify(form.view()) : mesh.distance < POOR) return;
    picture.draw();
    keep(view);
  };
  /** Whether the denoised picture is good enough to replace what is shown: a small one only where the kept one is of the same camera, or shows little of the view. */
  const isFineEnough = () => film.film.width >= FINE_SHARE * asked.width || (mesh.kept !== null && !meshed.hidden && [0, 1].includes(mesh.distance));

  const film = new ViewFilm();
  film.onTurn(() => {
    fit(film.film.width, film.film.height);
    picture.layers[0].setFilm(film.film);
  });
  film.onTile((tile) => picture.layers[0].putTile(film.film, tile));
  /** The latest request. */
  let asked = { width: 1, height: 1 };
  /** Handler of the next picked point. @type {((picked: Picked) => void) | null} */
  let onPicked = null;

  const darkWords = h("span");
  const studio = h("button", { class: "button small", type: "button", onclick: () => (form.light.choose("studio"), expose(0)) }, icon("sun"), t("Studio light"));
  const brighten = h("button", { class: "button small", type: "button", onclick: () => exposeAuto() }, icon("exposure"), t("Auto exposure"));
  const reframe = h("button", { class: "button small", type: "button", hidden: true, onclick: () => turn(framing()) }, icon("camera"), t("Frame the scene"));
  const dark = h("div", { class: "view-dark", role: "status", hidden: true }, darkWords, reframe, brighten, studio);
  /** The view of the automatic camera, which is the last one. */
  const framing = () => scene.cameras.at(-1)?.view ?? form.view();
  /** What chooses the exposure next: the first picture if it looks black, the next pictures of a new light, nothing more, or the user. @type {"first" | "light" | "done" | "user"} */
  let exposedBy = "first";
  /** The light that the exposure is for, without its strength: that is the user's own way to make it brighter. */
  let exposedLight = "";
  /** Brightness of the latest picture that was looked at. */
  let brightness = { white: 0, bright: 0, high: 0, key: 0 };
  /** Why the picture is exactly black: the camera sees no surface, or no light reaches those it sees; "": it is not, or that is not known yet. @type {"" | "empty" | "unlit"} */
  let blackness = "";
  /** Id of the latest black view that was probed. @type {number | null} */
  let probedView = null;
  /** Looks for the reason of a picture that is exactly black. @param {number} id of the view */
  const lookForBlackness = (id) => {
    if (!film.film.isBlack()) {
      endProbe();
    } else if (probedView !== id) {
      probedView = id;
      probing.begin(asked, (seesSomething) => {
        blackness = seesSomething ? "unlit" : "empty";
        tellDarkness();
      });
    }
  };
  const endProbe = () => {
    probing.end();
    probedView = null;
    if (!blackness) return;
    blackness = "";
    tellDarkness();
  };
  /** @param {number} id of the picture */
  const lookForDarkness = (id) => {
    brightness = film.film.brightness();
    const isBlack = darkness(brightness) !== null;
    const isLightShown = exposedBy === "light" && id === link.id;
    if (isLightShown || (exposedBy === "first" && isBlack)) setExposure(autoExposure(brightness));
    if (exposedBy !== "user" && (isLightShown ? sampledView === id : isBlack)) exposedBy = "done";
    tellDarkness();
  };
  const tellDarkness = () => {
    const black = darkness(brightness);
    const missing = autoExposure(brightness) - exposure.valueAsNumber;
    dark.hidden = !black && !blackness && missing < DULL_STOPS;
    studio.hidden = !black && blackness !== "unlit";
    reframe.hidden = blackness !== "empty";
    brighten.hidden = missing <= 0 || blackness !== "";
    if (!dark.hidden) setText(darkWords, darknessWords(blackness, black));
  };
  /** @param {number} stops */
  const setExposure = (stops) => {
    showExposure(exposure, stops);
    relook();
  };
  /** @param {number} stops chosen by the user */
  const expose = (stops) => {
    exposedBy = "user";
    setExposure(stops);
    tellDarkness();
  };
  const exposeAuto = () => expose(autoExposure(film.film.brightness()));
  /** @param {Record<string, any>} request */
  const noticeLight = ({ environment }) => {
    const { strength: _, rotation: __, ...light } = environment ?? {};
    const text = JSON.stringify(light);
    if (exposedLight && text !== exposedLight) {
      if (exposedBy !== "user") exposedBy = "light";
      if (mesh.kept === null) release(); // the mesh does not show the light
    }
    exposedLight = text;
  };
  /** Whether the kept picture shows another light than the latest request. */
  const isRelit = () => mesh.kept !== null && keptLight !== askedLight;
  /** @param {boolean} is whether the picture on the page is denoised */
  const setDenoised = (is) => {
    surface.dataset.denoised = String(is);
    film.film.isDenoised = is;
  };
  let lookedAt = -Infinity;
  /** When the view had MESH_SPP samples per pixel; 0: not yet. */
  let sampledAt = 0;
  /** Maximum number of pixels of the next request. */
  let mostPixels = MOST_PIXELS;
  /** Shows a picture or draft that has come. */
  const sampled = () => {
    if (!isSampled) {
      isSampled = true;
      loadMesh();
      if (state.textContent === clarity(0, null, false)) say("", false); // the counts come with the next message
    }
    if (!canvas.classList.contains("held-back")) uncoverSoon();
    picture.invalidate();
  };
  /** Id of the latest view that was clear. @type {number | null} */
  let clearId = null;
  /** Id of the latest view that had MESH_SPP samples per pixel. @type {number | null} */
  let sampledView = null;

  const link = new ViewLink(scene.id, {
    asked(id) {
      views.set(id, askedView);
      lights.set(id, askedLight);
      for (const each of [views, lights]) each.delete(id - MOST_VIEWS);
    },
    draft({ id, draft, exposure: draftExposure }) {
      if (canvas.width !== draft.width || canvas.height !== draft.height) fit(draft.width, draft.height);
      picture.layers[0].setAlpha(null);
      picture.layers[0].setImage(draft, draftExposure);
      mostPixels = MOST_PIXELS_OF_CARDS;
      surface.dataset.draft = String(id);
      setDenoised(false);
      sampled();
    },
    picture(next) {
      if (surface.dataset.draft !== String(next.id)) mostPixels = MOST_PIXELS;
      film.take(next);
      if (canvas.width !== next.width || canvas.height !== next.height) fit(next.width, next.height); // a draft had another size
      picture.layers[0].setFilm(film.film);
      picture.layers[0].setCoverage(film.film);
      if (performance.now() - lookedAt > DARKNESS_MS) {
        lookedAt = performance.now();
        lookForDarkness(next.id);
      }
      if (surface.dataset.view !== String(next.id)) setDenoised(false); // until the state says so
      surface.dataset.view = String(next.id);
      canvas.classList.toggle("outdated", isOutdated());
      sampled();
    },
    state(next) {
      const { samples, bound, mean, noise, done, slots, message } = next;
      const denoised = next.denoised && surface.dataset.view === String(next.id);
      const isLatest = next.id === link.id && !link.pending;
      surface.dataset.samples = String(samples);
      sampledAt = mean < MESH_SPP ? 0 : sampledAt || performance.now(); // another view begins anew
      if (sampledAt) sampledView = next.id;
      if (done && exposedBy === "light") lookForDarkness(Number(surface.dataset.view)); // no further picture comes
      const isDenoisedSoon = willBeDenoised() && !(sampledAt && performance.now() - sampledAt > (isRelit() ? RELIT_MS : DENOISED_MS));
      const isCleanBelow = meanwhile.isFinished && meshed.hidden;
      // The preview mesh is sharp: what replaces it must be as fine, and not smeared by denoising few samples.
      const isMeshTrue = mesh.kept === null && !meshed.hidden && !isChanged;
      const isClearBelow = isMeshTrue || (isCleanBelow && known !== "");
      const isSharp = !isClearBelow || done || !isDenoisedSoon || mean >= SHARP_SPP;
      const isEnough = mean >= (isDenoisedSoon ? DENOISED_SPP : isCleanBelow ? CLEAN_SPP : MESH_SPP);
      const isReady = (done && !isDenoisedSoon) || (denoised && isFineEnough() && isSharp) || (isEnough && (isFineEnough() || !isMeshTrue));
      if (isReady && (isLatest || !mesh.kept)) release();
      else if (denoised) keepNewer(next.id);
      setDenoised(denoised);
      if (isLatest && (done || (denoised && mean >= SHARP_SPP))) clearId = next.id;
      if (next.id !== null && isLatest && surface.dataset.view === String(next.id) && (done || mean >= BLACK_SPP)) lookForBlackness(next.id);
      if (message) say(saidOf(next, "message"));
      else if (bound) say(clarity(mean, noise, done, isCovered && canvas.classList.contains("held-back"), denoised), done);
      state.title = done ? "" : tn(slots, "{n} slot", "{n} slots");
    },
    failed: (sentence) => say(sentence),
    picked: (found) => (probing.take(found), onPicked?.(found)),
    people: ({ people: found }) => others.take(found),
    takes: () => void saved.load(),
    link: (up) => (up ? (others.renew(), void saved.load()) : say(t("The connection is lost; trying again."))),
    refused: (sentence) => say(sentence),
  });
  const probing = probe((at) => link.send({ pick: at }));
  const others = people(surface, { view: form.view, send: (message) => link.send(message), turnTo: (view) => turnTo(view) });
  /** @param {string} sentence @param {boolean} [aloud] by a screen reader: its end, and not each sample on the way */
  const say = (sentence, aloud = true) => {
    state.setAttribute("aria-live", aloud ? "polite" : "off");
    setText(state, sentence);
  };

  /** Gives the canvas the picture's size; layout scales it smoothly. @param {number} width @param {number} height */
  const fit = (width, height) => {
    canvas.width = width;
    canvas.height = height;
    picture.setPicture(width, height);
    viewport.resizeCanvas(width, height);
    viewport.show(1, width / 2, height / 2);
  };

  /** Whether the view's picture is of another projection, which nothing turns into the present one. */
  const isOutdated = () => {
    const view = views.get(Number(surface.dataset.view));
    return view !== undefined && projectionOf(view) !== projectionOf(form.view());
  };

  /** The first request. @type {string | undefined} */
  let firstAsked;
  /** The first request without its camera, and whether a later one differs in more than that: the preview mesh shows only the first. @type {string | undefined} */
  let firstShown;
  let isChanged = false;
  /** The latest request as the form and as the service have it, and its size on the page. @type {{text: string, sent: string, width: number, height: number} | undefined} */
  let lastAsked;
  /** Width of the view in CSS pixels. */
  let wide = 0;
  const refresh = () => {
    if (!form.element.checkValidity()) return;
    const request = viewRequest();
    noticeLight(request);
    const text = JSON.stringify(request);
    if (text !== (firstAsked ??= text) && meshed.hidden) release();
    const seen = JSON.stringify({ ...request, view: null, camera: null, width: null, height: null });
    isChanged ||= seen !== (firstShown ??= seen);
    surface.style.setProperty("--aspect", String((request.width ?? 1) / (request.height ?? 1)));
    const { width, height } = sizeFor(request.width ?? 1, request.height ?? 1, wide, mostPixels);
    const wanted = { ...request, ...clear.request(), ...denoise.request(), width, height, alpha: true };
    const sent = JSON.stringify(wanted);
    if (sent !== lastAsked?.sent) {
      if (lastAsked && text !== lastAsked.text && Math.abs(width * lastAsked.height - height * lastAsked.width) <= width + height) hold();
      lastAsked = { text, sent, width, height };
      asked = { width, height };
      askedView = form.view();
      askedLight = JSON.stringify(request["environment"] ?? null);
      endProbe();
      const drafts = instead.isOpen ? {} : { draft: exposure.valueAsNumber }; // whose values a stage cannot compare
      link.show({ ...wanted, ...drafts });
      canvas.classList.toggle("outdated", isOutdated());
    }
    if (isCovered) mesh.setView(form.view());
    others.changed();
    saved.changed();
    offer();
    if (focused && form.view().aperture) tell();
  };
  /** @param {View} view */
  const turn = (view) => {
    others.stop();
    turnTo(view);
  };
  /** @param {View} view */
  const turnTo = (view) => {
    form.turn(view);
    showPassedMesh(); // a previous picture is of another view
    showMesh();
    refresh();
    turned(view);
  };

  /** State of the stage that replaces the view. */
  let instead = { isOpen: false, hasLive: true };
  /** Shows the tools that are applicable. */
  const offer = () => {
    const canFocus = (form.view().projection ?? "perspective") === "perspective";
    for (const [name, button] of tools.buttons) {
      button.hidden = instead.isOpen ? !(instead.hasLive && name === "light") : name === "focus" && !canFocus;
      if (button.hidden && tools.chosen() === name) tools.choose("");
    }
  };
  /** Whether the lens is focused but has no aperture yet, so that the focus is not visible. */
  let focused = false;
  const tell = (/** @type {string} */ sentence = "") => {
    focused = false;
    const touch = matchMedia("(pointer: coarse)").matches;
    const usual = touch
      ? t("Two fingers move the view; tap it first to turn it with one.")
      : t("Drag to turn, Shift-drag to move, scroll to zoom; W A S D Q E to fly.");
    const ofStage = touch
      ? t("A finger across moves the picture, two zoom.")
      : t("Drag moves the picture, the wheel zooms; Escape goes back to the live view.");
    setText(said, sentence || (instead.isOpen ? ofStage : usual));
    said.classList.toggle("usual", !sentence);
  };

  /** @param {MouseEvent} event @param {(picked: Picked, at: {x: number, y: number}) => void} then */
  const pick = (event, then) => {
    const box = surface.getBoundingClientRect();
    const within = (/** @type {number} */ share, /** @type {number} */ size) => Math.min(Math.max(Math.floor(share * size), 0), size - 1);
    const at = {
      x: within((event.clientX - box.left) / box.width, asked.width),
      y: within((event.clientY - box.top) / box.height, asked.height),
    };
    onPicked = (found) => {
      if (found.x !== at.x || found.y !== at.y) return; // of an earlier click
      onPicked = null;
      then(found, at);
    };
    link.send({ pick: [at.x, at.y] });
  };
  /** @param {PointerEvent} event */
  const focusAt = (event) =>
    pick(event, ({ depth }, at) => {
      if (!depth) {
        tell(t("There is nothing to focus on here. Click an object."));
        return;
      }
      const distance = alongSight(form.view(), asked, at, depth);
      form.focus(distance);
      tools.choose("");
      const told = t("Sharp at a distance of {distance}.", { distance: distance.toPrecision(4) });
      tell(form.view().aperture ? told : t("{told} Give the lens an aperture to see it.", { told }));
      focused = !form.view().aperture;
      refresh();
    });
  const frame = h("div", { class: "live-view-frame" }, surface);
  const light = lightHand(frame, () => stage.shown() ?? surface, form.light);
  const tools = viewTools(
    surface,
    [
      light.tool,
      sunHand(surface, form.light, pick, tell),
      {
        ...{ name: "focus", icon: /** @type {const} */ ("target"), label: t("Pick the focus"), short: t("Focus"), title: t("Pick the focus") },
        ...{ hint: t("Click what is to be sharp."), press: focusAt },
      },
    ],
    tell,
  );
  const letGo = viewHand(surface, {
    view: form.view,
    turn,
    size: diagonal(scene.bounds),
    pressed: tools.press,
    keyed: tools.key,
    centre: (event) => tools.chosen() || pick(event, ({ position }) => position && turn(lookAt(form.view(), position))),
  });
  const lightKey = heldKey("l", () => tools.chosen() === "light", (on) => {
    if (instead.isOpen && !instead.hasLive) return;
    tools.choose(on ? "light" : "");
    if (on) (instead.isOpen ? tools.buttons.get("light") : surface)?.focus({ preventScroll: true });
  });
  tools.buttons.get("light")?.addEventListener("keydown", (event) => tools.key(event) && event.preventDefault());
  const endPart = addPart("display", {
    get: () => look.value,
    set: (/** @type {{exposure?: number, curve?: string}} */ shown) => {
      curve.value = [...curve.options].some(({ value }) => value === shown.curve) ? (shown.curve ?? "") : DEFAULT_CURVE;
      expose(Number(shown.exposure) || 0);
    },
  });
  const endKeys = addShortcuts([
    { keys: "N", does: t("Auto exposure"), run: exposeAuto },
    { keys: "L", shown: t("L, arrows"), does: t("Turn the light: hold and drag, or press and use the arrows"), run: lightKey.down },
    {
      keys: "Escape",
      does: t("Undo the drag; put the tool away; return to the live view"),
      run: () => void (tools.escape() || sides.set({ a: LIVE, b: "" })),
    },
    ...HAND_KEYS.map(({ keys, does }) => ({
      ...{ keys: `View: ${keys}`, does, run: () => {} },
      get shown() {
        return instead.isOpen ? null : keys;
      },
    })),
  ]);
  const placeSun = () => (tools.choose("sun"), surface.scrollIntoView({ block: "nearest" }), surface.focus({ preventScroll: true }));
  form.element.addEventListener(PLACE_SUN, placeSun);

  const look = new Store({ exposure: 0, curve: DEFAULT_CURVE });
  const saved = takes(scene, {
    state: () => ({ request: { scene: scene.id, ...viewRequest() }, exposure: exposure.valueAsNumber, tonemap: curve.value }),
    picture: () => (isSampled ? smallPicture(picture, canvas) : null),
    restore(take) {
      others.stop();
      if (instead.isOpen && !instead.hasLive) sides.set({ a: LIVE, b: "" });
      form.restore(startOfTake(take, form.request()));
      const hasCurve = [...curve.options].some(({ value }) => value === take.tonemap);
      curve.value = hasCurve ? take.tonemap : DEFAULT_CURVE;
      expose(take.exposure);
      showMesh();
      refresh();
      turned(form.view());
    },
  });
  const toolBar = h("div", { class: "view-tool-bar" }, [...tools.buttons.values()], saved.save);
  const looks = h("div", { class: "view-looks" }, h("div", { class: "view-exposure" }, auto, exposure, shown), viewMore(frame, clear.element, denoise.element, curve));
  const pills = h("div", { class: "view-pills" }, state, said, dark);
  const stage = viewStage({
    ...{ scene: scene.id, sides, live: film, look, names },
    changed(now) {
      instead = now;
      surface.hidden = now.isOpen;
      state.hidden = clear.element.hidden = toolBar.hidden = said.hidden = now.isOpen && !now.hasLive;
      link.rest(state.hidden);
      offer();
      tell();
    },
  });
  frame.append(stage.element, light.readout, pills, others.element, h("div", { class: "view-floating", role: "toolbar", "aria-label": t("View") }, toolBar, looks));
  // The light tool also works over the stage, which otherwise pans its picture.
  frame.addEventListener(
    "pointerdown",
    (event) => {
      const onPicture = instead.isOpen && instead.hasLive && !(/** @type {Element} */ (event.target).closest(".wipe, .view-floating"));
      if (onPicture && tools.press(event)) event.stopPropagation();
    },
    true,
  );
  frame.addEventListener("contextmenu", (event) => event.shiftKey && event.preventDefault());
  const element = h(
    "div",
    { class: "live-view-box" },
    frame,
    stage.bar,
  );
  const relook = () => {
    look.set({ exposure: exposure.valueAsNumber, curve: curve.value });
    saved.changed();
  };
  look.subscribe((now) => {
    picture.look = now;
    mesh.setLook(now);
    setText(shown, `${stops(now.exposure)} EV`);
    exposure.setAttribute("aria-valuetext", `${stops(now.exposure)} EV`);
    picture.invalidate();
  });
  exposure.addEventListener("input", () => expose(exposure.valueAsNumber));
  exposure.addEventListener("change", () => showExposure(exposure, exposure.valueAsNumber)); // at its end, the range grows
  exposure.addEventListener("dblclick", () => expose(0));
  curve.addEventListener("change", relook);

  const resizing = new ResizeObserver(() => {
    const { clientWidth } = stage.shown() ?? surface;
    if (!clientWidth || Math.abs(clientWidth - wide) < 2) return;
    wide = clientWidth;
    refresh();
  });
  for (const each of [surface, stage.element]) resizing.observe(each);
  /** Keeps the view's picture for the next time that it is opened, if it is clear and looks as a view does that is opened. */
  const keepClear = () => {
    const isUsual = look.value.exposure === 0 && look.value.curve === DEFAULT_CURVE;
    const isShown = clearId === link.id && Number(surface.dataset.view) === clearId && !link.pending && !canvas.classList.contains("held-back");
    const request = viewRequest();
    if (isUsual && isShown && request["background"] !== "transparent") keepClearView(scene.id, JSON.stringify(request), pictureUrl(picture, canvas, CLEAR_SIDE));
  };
  addEventListener("pagehide", keepClear);
  refresh();
  if (!instead.isOpen) tell();
  return {
    element,
    takes: saved.element,
    refresh,
    look: () => look.value,
    firstLook() {
      const isSame = !link.pending && Number(surface.dataset.view) === link.id;
      const isHeld = isCovered && canvas.classList.contains("held-back");
      return { film: film.film, isSame, clean: !isHeld ? "" : meshed.hidden ? meanwhile.url : meshPicture(mesh, meshed) };
    },
    dispose() {
      keepClear();
      removeEventListener("pagehide", keepClear);
      isDisposed = true;
      clearTimeout(uncovering);
      resizing.disconnect();
      probing.end();
      stage.dispose();
      letGo();
      light.dispose();
      lightKey.dispose();
      endKeys();
      endPart();
      form.element.removeEventListener(PLACE_SUN, placeSun);
      others.dispose();
      denoise.dispose();
      saved.dispose();
      link.close();
      mesh.dispose();
      picture.dispose();
    },
  };
}

/** Stops at the ends of the exposure's slider, unless it is set beyond, and at most. */
const [USUAL_STOPS, MOST_STOPS] = [6, 16];

/** Sets the exposure's slider, whose range grows with the value. @param {HTMLInputElement} slider @param {number} value in stops */
function showExposure(slider, value) {
  const end = Math.abs(value) < USUAL_STOPS ? USUAL_STOPS : Math.min(2 * Math.ceil(Math.abs(value)), MOST_STOPS);
  slider.min = String(-end);
  slider.max = String(end);
  slider.value = String(value);
  slider.title = t("Exposure from {low} to {high} EV; double-click for 0", { low: stops(-end), high: stops(end) });
}

/** @param {"" | "empty" | "unlit"} blackness @param {import("../film/darkness.js").Darkness | null} dark */
function darknessWords(blackness, dark) {
  if (blackness === "empty") return t("The camera sees nothing");
  if (blackness === "unlit") return t("No light reaches what the camera sees");
  return dark ? t("Very dark: brightest {n}", { n: dark.brightest.toPrecision(1) }) : t("Dark at this exposure");
}

/** @param {View} view */
const projectionOf = ({ projection }) => projection ?? "perspective";

/** Whether a picture of one camera can be shown for another. @param {View} from @param {View} to */
const canKeep = (from, to) =>
  JSON.stringify(from) === JSON.stringify(to) || (projectionOf(from) === projectionOf(to) && from.projection !== "panorama");

/** Returns what a view shows as a small picture in base64. @param {FilmCanvas} picture @param {HTMLCanvasElement} canvas of the picture */
function smallPicture(picture, canvas) {
  const url = pictureUrl(picture, canvas, TAKE_SIDE);
  return url.slice(url.indexOf(",") + 1);
}

/**
 * Returns what a view shows as the URL of a picture.
 *
 * @param {FilmCanvas} picture
 * @param {HTMLCanvasElement} canvas of the picture
 * @param {number} side the longer one, in pixels, at most
 */
function pictureUrl(picture, canvas, side) {
  picture.draw(); // WebGL keeps its picture only until the next frame
  const scale = Math.min(1, side / Math.max(canvas.width, canvas.height));
  const small = h("canvas", { width: Math.max(1, Math.round(canvas.width * scale)), height: Math.max(1, Math.round(canvas.height * scale)) });
  small.getContext("2d")?.drawImage(canvas, 0, 0, small.width, small.height);
  const url = small.toDataURL("image/webp", 0.85);
  return url.startsWith("data:image/webp") ? url : small.toDataURL("image/jpeg", 0.85); // Safari writes no WebP
}

/**
 * Returns a preview mesh as the URL of a JPEG.
 *
 * @param {import("./mesh-canvas.js").MeshCanvas} mesh
 * @param {HTMLCanvasElement} canvas of the mesh
 */
function meshPicture(mesh, canvas) {
  const { width, height } = canvas;
  const whole = h("canvas", { width, height });
  const brush = whole.getContext("2d");
  if (!brush) return "";
  mesh.draw(); // WebGL keeps its picture only until the next frame
  brush.drawImage(canvas, 0, 0);
  return whole.toDataURL("image/jpeg", 0.92);
}

/**
 * Returns the view's size on screen, in pixels, with the picture's aspect ratio.
 *
 * @param {number} width of the requested picture
 * @param {number} height
 * @param {number} wide the view, in CSS pixels; 0: not known yet
 * @param {number} mostPixels
 */
function sizeFor(width, height, wide, mostPixels) {
  const most = Math.max(LEAST_SIDE, (wide || 320) * Math.min(devicePixelRatio, 2));
  const scale = Math.min(most / width, Math.sqrt(mostPixels / (width * height)));
  return { width: Math.max(1, Math.round(width * scale)), height: Math.max(1, Math.round(height * scale)) };
}

/** @param {string} frames of a shot */
function firstOf(frames) {
  const numbers = parseFrames(frames);
  return typeof numbers === "string" ? 0 : (numbers[0] ?? 0);
}

/** @param {number[][] | null} bounds */
function diagonal(bounds) {
  const [lower, upper] = bounds ?? [];
  return lower && upper ? Math.hypot(...upper.map((value, i) => value - (lower[i] ?? 0))) || 1 : 1;
}
