/**
 * The live view of a scene: the farm renders the form's current request while the user navigates. It is not a job; the farm keeps
 * one picture of the view that a scene is opened with, its poster.
 */

import { h, setText } from "../base/dom.js";
import { saidOf } from "../base/said.js";
import { t, tn } from "../base/words.js";
import { CannotShow, FilmCanvas } from "../film/film-canvas.js";
import { Film } from "../film/film.js";
import { DEFAULT_CURVE } from "../film/tonemap.js";
import { Viewport } from "../film/viewport.js";
import { addPart } from "../shell/layouts.js";
import { PREPARING, clarity, clarityField, nothingWords, previewWords, progressWords, roughWords } from "./clarity.js";
import { clearView, keepClearView } from "./clear-views.js";
import { Cover } from "./cover.js";
import { onceDrawn } from "./drawn.js";
import { darknessNotice } from "./darkness-notice.js";
import { denoiseView } from "./denoise-view.js";
import { exposureHand } from "./exposure-hand.js";
import { frameHand } from "./frame-hand.js";
import { otherSide } from "./other-side.js";
import { startOfTake } from "./form-start.js";
import { meshBrightness } from "./mesh-brightness.js";
import { takeMesh } from "./mesh-relay.js";
import { mayBeInView } from "./in-view.js";
import { people } from "./people.js";
import { invisibleWords } from "./scene-notices.js";
import { sideHand } from "./side-hand.js";
import { LIVE } from "./sides.js";
import { takes } from "./takes.js";
import { projectionOf } from "./projection.js";
import { sceneOf } from "./requested-scene.js";
import { SHARP_SPP, neededSpp } from "./replacement.js";
import { ViewFilm } from "./view-film.js";
import { viewHands } from "./view-hands.js";
import { ViewLink } from "./view-link.js";
import { viewMore } from "./view-more.js";
import { pictureData, pictureUrl } from "./view-pictures.js";
import { shapeView, sizeFor, viewRequest } from "./view-request.js";
import { viewStage } from "./view-stage.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("./requested-scene.js").Requested} Requested */

/** Maximum number of pixels rendered, whatever the screen's size; and where graphics cards make drafts. */
const [MOST_PIXELS, MOST_PIXELS_OF_CARDS] = [1 << 20, 1 << 21];
/** Longer sides, in pixels, of a take's picture, and of the one that is shown when the view is opened again. */
const [TAKE_SIDE, CLEAR_SIDE] = [320, 1280];
/** Interval, in milliseconds, of checks whether the view is too dark. */
const DARKNESS_MS = 500;
/** Samples per pixel from which every pixel has one, and from which a black view is known to be without light: with fewer, light of few paths may not have been found. */
const [WHOLE_SPP, BLACK_SPP] = [1, 4];
/** Number of requests that are remembered. */
const MOST_REQUESTS = 256;

/**
 * @typedef {object} LiveView
 * @property {HTMLElement} element
 * @property {HTMLElement | null} takes the strip of the scene's takes
 * @property {() => void} refresh requests a new view after a change of the form
 * @property {() => void} dispose
 * @property {() => {exposure: number, curve: string}} look
 * @property {(look: {exposure: number, curve: string}) => void} setLook
 * @property {() => import("../film/first-look.js").FirstLook} firstLook what a job that is started now shows first
 */

/** @returns {import("../film/first-look.js").FirstLook} */
const noLook = () => ({ film: new Film(1, 1), isSame: false, clean: "" });

/** Returns what replaces the live view where the browser cannot show it. @param {string} reason @returns {LiveView} */
const withoutView = (reason) => ({
  ...{ element: h("p", { class: "notice" }, reason), takes: null, refresh: () => {}, dispose: () => {} },
  ...{ look: () => ({ exposure: 0, curve: DEFAULT_CURVE }), setLook: () => {}, firstLook: noLook },
});

/**
 * @param {import("../base/types.js").Scene} scene
 * @param {import("./settings-form.js").SettingsForm} form
 * @param {import("./cover.js").Meanwhile} meanwhile
 * @param {(view: View) => void} turned called when the user moves the camera
 * @param {import("../base/store.js").Store<import("./sides.js").Sides>} sides the pictures shown in place of the live view
 * @param {(a: Job, b: Job) => [string, string]} names of two pictures, made of their differences
 * @returns {LiveView}
 */
export function liveView(scene, form, meanwhile, turned, sides, names) {
  const canvas = h("canvas", { role: "img", "aria-label": t("Live picture of the scene") });
  const over = h("canvas", { hidden: true });
  const mesh = takeMesh(scene.id);
  mesh.canvas.ariaHidden = "true";
  mesh.canvas.hidden = true;
  const surface = h(
    "div",
    {
      class: "live-view",
      tabindex: "0",
      role: "application",
      "aria-label":
        t("The view. Arrows turn it, Shift and arrows move it, plus and minus go nearer and farther; W, A, S, D, Q and E fly."),
    },
    mesh.canvas,
    canvas,
    over,
  );
  const viewport = new Viewport();
  /** @type {FilmCanvas} */
  let picture;
  try {
    picture = new FilmCanvas(canvas, over, viewport);
  } catch (error) {
    if (!(error instanceof CannotShow)) throw error;
    mesh.dispose();
    return withoutView(error.message);
  }
  const frame = h("div", { class: "live-view-frame" }, surface);
  const state = h("p", { class: "small quiet number view-state", role: "status", "aria-live": "off" });
  /** Kind of the sentence in the pill, if a later event replaces it. @type {"" | "preparing" | "waiting" | "nothing"} */
  let told = "";
  /** @param {string} sentence @param {boolean} [aloud] by a screen reader: its end, and not each sample on the way @param {typeof told} [is] */
  const say = (sentence, aloud = true, is = "") => {
    told = sentence || isSeen ? is : "preparing";
    if (told === "preparing") sentence = meanwhile.steps.line || PREPARING;
    state.setAttribute("aria-live", aloud ? "polite" : "off");
    setText(state, sentence);
  };
  /** Whether a picture of the view is seen. */
  let isSeen = false;
  /** Whether the mesh is drawn. */
  let isDrawn = false;
  /** Folds the steps of an upload once the view shows the scene, and ends them once its own picture is seen. */
  const followCover = () => {
    if (isSeen) return;
    const isShown = cover.isMeshShown ? isDrawn : cover.shown !== "nothing";
    if (isShown && meanwhile.steps.fold() && told === "preparing") say("", false);
    if (!cover.isSampled || cover.isHeld) return;
    isSeen = true;
    meanwhile.steps.end();
  };
  say("", false);
  const clear = clarityField(() => refresh());
  const denoise = denoiseView(() => refresh());
  const request = () => viewRequest(form.request());

  const film = new ViewFilm();
  const layer = picture.layers[0];
  film.onTurn(() => {
    fit(film.film);
    layer.setFilm(film.film);
  });
  film.onTile((tile) => layer.putTile(film.film, tile));
  let fitted = { width: 0, height: 0 };
  /** Gives the canvas a picture's size; layout scales it smoothly. @param {{width: number, height: number}} of */
  const fit = ({ width, height }) => {
    if (fitted.width === width && fitted.height === height) return;
    fitted = { width, height };
    canvas.width = width;
    canvas.height = height;
    picture.setPicture(width, height);
    viewport.resizeCanvas(width, height);
    viewport.show(1, width / 2, height / 2);
  };

  const known = clearView(scene.id, JSON.stringify(request()));
  const isDenoised = Boolean(denoise.request().denoise);
  const cover = new Cover(
    scene,
    known ? { url: known, nearest: "", isFinished: true, isSame: true, isClear: true, steps: meanwhile.steps } : { ...meanwhile, isSame: meanwhile.isSame && isDenoised },
    { surface, canvas, picture, mesh, view: form.view, laid: () => (followCover(), warnEarly(), exposePreview()), willBeDenoised: () => denoise.isOn() && form.request().background !== "transparent" }, // the denoiser makes no alpha
  );
  const endWait = onceDrawn(mesh, () => ((isDrawn = true), followCover()));
  const hand = exposureHand(() => film.film);
  const aspect = () => (request().width ?? 1) / (request().height ?? 1);
  /** Returns the scene's bounds; null where it is not shown as uploaded, of which they are. @returns {[Vec3, Vec3] | null} */
  const bounds = () => {
    const { frame, up, variant } = request();
    const [low, high] = /** @type {Vec3[]} */ (scene.bounds ?? []);
    return !low || !high || frame || up || variant != null ? null : [low, high];
  };
  const invisible = () => invisibleWords(scene, bounds() !== null);
  const framing = frameHand(scene, { view: form.view, aspect, bounds, turn: (view) => turn(view) });
  const opposite = otherSide(scene, { view: form.view, turn: (view) => turn(view) });
  const standard = sideHand({ view: form.view, side: (name) => ((instead.isOpen && !instead.hasLive) || invisible() ? null : form.side(name)), turn: (view) => turn(view) });
  const dark = darknessNotice({
    film: () => film.film,
    look: hand.look,
    size: () => size,
    pick: (at) => link.send({ pick: at }),
    isPicking: () => hands.isPicking(),
    mayShow() {
      const box = bounds();
      return !box || cover.requested.isChanged || mayBeInView(form.view(), aspect(), ...box);
    },
    invisible,
    brighten: hand.exposeAuto,
    light: () => (form.light.choose("studio"), hand.expose(0)),
    reframe: () => framing.frame(),
    setCaution: form.setCaution,
  });

  const warnEarly = () => dark.warnEarly(cover.isBlackBehind);

  /** Exposes a new light as soon as the mesh shows it. */
  const exposePreview = () => {
    if (!hand.awaitsPreview || !cover.isMeshAlone) return;
    if (mesh.isWaiting) return void mesh.ready.then(exposePreview);
    hand.adaptPreview(meshBrightness(mesh)); // once: measuring draws another frame
  };

  /** The latest requests, by their ids. @type {Map<number, Requested>} */
  const requests = new Map();
  /** The latest request as the form and as the service have it. @type {{text: string, sent: string} | undefined} */
  let latest;
  /** Camera of the latest request, which is sent with the next frame, and the rest of it. @type {Requested} */
  let next = { view: form.view(), scene: "" };
  /** Size of the latest request, in pixels. */
  let size = { width: 1, height: 1 };
  /** Maximum number of pixels of the next request. */
  let mostPixels = MOST_PIXELS;
  /** Width of the view in CSS pixels. */
  let wide = 0;
  /** Id of the view whose picture or draft the canvas shows, of the latest one with SHARP_SPP samples per pixel, denoised or done, and of the latest one that was clear. */
  let [shownId, settledId, clearId] = /** @type {(number | null)[]} */ ([null, null, null]);
  let lookedAt = -Infinity;
  /** Samples per pixel of the denoised picture in the canvas; 0: it has noise. */
  let shownSpp = 0;
  /** The largest number of samples per pixel that the pill has stated, and its view. @type {{id: number | null, n: number}} */
  let counted = { id: null, n: 0 };

  const pictureId = () => Number(surface.dataset.view);
  /** Whether the view's picture has another projection, from which the present one cannot be computed. */
  const isOutdated = () => {
    const of = requests.get(pictureId());
    return of !== undefined && projectionOf(of.view) !== projectionOf(form.view());
  };
  /** @param {boolean} is whether the picture on the page is denoised */
  const setDenoised = (is) => {
    surface.dataset.denoised = String(is);
    film.film.isDenoised = is;
  };
  const lookForDarkness = (/** @type {number} */ id) => {
    const brightness = film.film.brightness();
    hand.adapt(brightness, link.isLatest(id), id === settledId);
    dark.look(brightness);
  };
  const sampled = () => {
    if (cover.sampled() && told === "waiting") say("", false); // the counts come with the next message
    followCover();
    picture.invalidate();
  };

  const link = new ViewLink(scene.id, {
    asked(id) {
      requests.set(id, next);
      requests.delete(id - MOST_REQUESTS);
    },
    draft({ id, draft, exposure }) {
      fit(draft);
      layer.setAlpha(null);
      layer.setImage(draft, exposure);
      mostPixels = MOST_PIXELS_OF_CARDS;
      surface.dataset.draft = String(id);
      shownId = id;
      setDenoised(false);
      cover.drafted();
      sampled();
    },
    picture(found) {
      if (surface.dataset.draft !== String(found.id)) mostPixels = MOST_PIXELS;
      film.take(found);
      fit(found); // a draft had another size
      layer.setFilm(film.film);
      layer.setCoverage(film.film);
      if (performance.now() - lookedAt > DARKNESS_MS) {
        lookedAt = performance.now();
        lookForDarkness(found.id);
      }
      if (surface.dataset.view !== String(found.id)) setDenoised(false); // until the state says so
      surface.dataset.view = String(found.id);
      shownId = found.id;
      canvas.classList.toggle("outdated", isOutdated());
      sampled();
    },
    state(found) {
      const { id, samples, bound, mean, noise, done, slots, message } = found;
      const denoised = found.denoised && shownId === id && pictureId() === id; // a draft of a later view may have replaced the picture
      const isLatest = link.isLatest(id);
      surface.dataset.samples = String(samples);
      if (found.sample_s) form.measure(found.sample_s);
      if (done || denoised || mean >= SHARP_SPP) settledId = id;
      if ((done || denoised) && hand.awaitsLight) lookForDarkness(pictureId()); // before it is shown, or if no further picture comes
      const spp = denoised ? (found.denoised_samples ?? mean) : mean;
      const denoises = cover.willBeDenoised() && (found.denoises || !mean); // unknown until the view has samples
      cover.judge({ mean, spp, isLast: done && spp >= mean, isDenoised: denoised, isLatest, denoises, share: film.film.width / size.width }, requests.get(id ?? 0));
      followCover();
      setDenoised(denoised);
      shownSpp = denoised ? spp : 0;
      if (isLatest && (done || (denoised && spp >= SHARP_SPP))) clearId = id;
      if (id !== null && isLatest && pictureId() === id && (done || mean >= WHOLE_SPP)) dark.explain(id, done || mean >= BLACK_SPP);
      mesh.expect(slots > 0 && !done && !message);
      const part = isLatest ? mean / neededSpp(cover.shown, denoises) : 0;
      meanwhile.steps.follow(part, saidOf(found, "message"), denoises);
      if (message) say(saidOf(found, "message"));
      else if (bound && (isLatest || cover.isInstead)) {
        const isRough = !cover.isInstead && denoised && !spp; // a small picture
        if (counted.id !== id) counted = { id, n: 0 };
        if (!cover.isInstead) counted.n = Math.max(counted.n, spp); // a denoised picture may have fewer than the noise had before it
        if (invisible()) say(nothingWords, done, "nothing");
        else if (cover.isInstead) say((!done && !cover.isOtherLight && meanwhile.steps.line) || previewWords(done, cover.isOtherLight, part, denoises), done);
        else say(isRough ? roughWords : clarity(counted.n, noise, done, denoised), done, counted.n ? "" : "waiting");
      }
      state.title = done ? "" : [progressWords(mean, noise), tn(slots, "{n} slot", "{n} slots")].filter(Boolean).join(", ");
    },
    failed: (sentence) => say(sentence),
    picked: (found) => (dark.take(found), hands.take(found)),
    people: ({ people: found }) => others.take(found),
    takes: () => void saved.load(),
    link: (up) => (up ? (others.renew(), void saved.load()) : say(t("The connection is lost; trying again."))),
    refused: (sentence) => say(sentence),
  });
  const others = people(surface, { view: form.view, send: (message) => link.send(message), turnTo: (view) => turnTo(view) });

  const refresh = () => {
    if (!form.element.checkValidity()) return;
    const now = request();
    hand.noticeLight(now["environment"]);
    cover.compare(now);
    shapeView(frame, (now.width ?? 1) / (now.height ?? 1));
    const { width, height } = sizeFor(now.width ?? 1, now.height ?? 1, wide, mostPixels);
    const wanted = { ...now, ...clear.request(), ...denoise.request(), width, height, alpha: true };
    const [text, sent] = [JSON.stringify(now), JSON.stringify(wanted)];
    const isChanged = latest !== undefined && sent !== latest.sent;
    if (sent !== latest?.sent) {
      const isSameShape = Math.abs(width * size.height - height * size.width) <= width + height;
      const isClean = surface.dataset.denoised === "true" && film.film.isDenoised;
      if (latest && text !== latest.text && isSameShape && isClean) cover.hold(requests.get(pictureId()));
      latest = { text, sent };
      size = { width, height };
      next = { view: form.view(), scene: sceneOf(now) };
      dark.endBlackness();
      const drafts = instead.isOpen ? {} : { draft: hand.look.value.exposure }; // whose values a stage cannot compare
      link.show({ ...wanted, ...drafts });
      canvas.classList.toggle("outdated", isOutdated());
    }
    cover.follow();
    followCover();
    if (invisible()) say(nothingWords, true, "nothing");
    else if (told === "nothing") say(""); // another variant or frame shows something
    else if (cover.isInstead && isChanged && surface.dataset.samples) {
      meanwhile.steps.follow(0, "", cover.willBeDenoised()); // the last part was of the view before
      say(meanwhile.steps.line || previewWords(false, cover.isOtherLight), false);
    }
    warnEarly();
    exposePreview();
    framing.update();
    opposite.update();
    standard.update();
    others.changed();
    saved.changed();
    hands.update();
  };
  /** @param {View} view */
  const turn = (view) => {
    others.stop();
    turnTo(view);
  };
  /** @param {View} view */
  const turnTo = (view) => {
    form.turn(view);
    cover.showMesh(); // a previous picture is of another view
    refresh();
    turned(view);
  };

  /** State of the stage that replaces the view. */
  let instead = { isOpen: false, hasLive: true };
  const leaveStage = () => sides.set({ a: LIVE, b: "" });
  const hands = viewHands({
    ...{ scene, form, frame, surface, turn, refresh, leaveStage },
    instead: () => instead,
    seen: () => stage.shown() ?? surface,
    size: () => size,
    pick(at) {
      dark.stopProbing(); // the service answers only the latest pick
      link.send({ pick: at });
    },
    exposeAuto: hand.exposeAuto,
  });
  const endPart = addPart("display", {
    get: () => hand.look.value,
    set: (/** @type {{exposure?: number | null, curve?: string}} */ { exposure, curve = "" }) => (exposure === null ? hand.reset() : hand.restore(Number(exposure) || 0, curve)),
  });
  const saved = takes(scene, {
    state: () => ({ request: { scene: scene.id, ...request() }, exposure: hand.look.value.exposure, tonemap: hand.look.value.curve }),
    picture: () => (cover.isSampled ? pictureData(picture, canvas, TAKE_SIDE) : null),
    restore(take) {
      others.stop();
      if (instead.isOpen && !instead.hasLive) leaveStage();
      form.restore(startOfTake(take, form.request()));
      hand.restore(take.exposure, take.tonemap);
      cover.showMesh();
      refresh();
      turned(form.view());
    },
  });
  const toolBar = h("div", { class: "view-tool-bar" }, hands.buttons, saved.save);
  const looks = h("div", { class: "view-looks" }, hand.element, viewMore(frame, clear.element, denoise.element, hand.curve));
  const pills = h("div", { class: "view-pills" }, state, meanwhile.steps.isOpen && meanwhile.steps.element, framing.element, opposite.element, h("div", { class: "view-corner" }, standard.element, hands.hint, others.element), dark.element);
  const stage = viewStage({
    ...{ scene: scene.id, sides, live: film, look: hand.look, names },
    changed(now) {
      instead = now;
      surface.hidden = now.isOpen;
      state.hidden = clear.element.hidden = toolBar.hidden = hands.hint.hidden = now.isOpen && !now.hasLive;
      link.rest(state.hidden);
      standard.update();
      hands.update();
      hands.tell();
    },
  });
  frame.append(stage.element, hands.readout, pills, h("div", { class: "view-floating", role: "toolbar", "aria-label": t("View") }, toolBar, looks));
  hand.look.subscribe((now) => {
    picture.look = now;
    mesh.setLook(now);
    picture.invalidate();
    saved.changed();
  });

  const resizing = new ResizeObserver(() => {
    const { clientWidth } = stage.shown() ?? surface;
    if (!clientWidth || Math.abs(clientWidth - wide) < 2) return;
    wide = clientWidth;
    refresh();
  });
  for (const each of [surface, stage.element]) resizing.observe(each);
  /** Keeps the view's picture for the next time that it is opened, if it is clear and looks as a view does that is opened. */
  const keepClear = () => {
    const { exposure, curve } = hand.look.value;
    const isUsual = exposure === 0 && curve === DEFAULT_CURVE;
    const isShown = link.isLatest(clearId) && pictureId() === clearId && !cover.isHeld;
    const now = request();
    if (isUsual && isShown && now["background"] !== "transparent") keepClearView(scene.id, JSON.stringify(now), pictureUrl(picture, canvas, CLEAR_SIDE));
  };
  addEventListener("pagehide", keepClear);
  refresh();
  if (!instead.isOpen) hands.tell();
  return {
    element: h("div", { class: "live-view-box" }, frame, stage.bar),
    takes: saved.element,
    refresh,
    look: () => hand.look.value,
    setLook: ({ exposure, curve }) => hand.restore(exposure, curve),
    firstLook() {
      if (cover.isInstead && cover.isOutdated) return noLook(); // a picture in another light would be taken for the job's
      const isSame = link.isLatest(pictureId());
      return { film: film.film, isSame, clean: cover.pictureUrl(), worth: cover.isInstead ? cover.worth() : isSame ? shownSpp : 0 };
    },
    dispose() {
      keepClear();
      removeEventListener("pagehide", keepClear);
      resizing.disconnect();
      for (const each of [dark, stage, framing, standard, hands, others, denoise, saved]) each.dispose();
      endPart();
      endWait();
      link.close();
      cover.dispose();
      picture.dispose();
    },
  };
}
