/**
 * The view of a scene that is being prepared: its mesh, as soon as this page or a worker has read it, or an example's picture until it
 * is turned. It turns as the live view does.
 */

import { h, setText } from "../base/dom.js";
import { t } from "../base/words.js";
import { homeCamera } from "../forms/camera-fields.js";
import { sideView } from "../forms/side-views.js";
import { examplePictures } from "../news/example-pictures.js";
import { localMeshOf } from "../news/local-mesh.js";
import { PREPARING } from "./clarity.js";
import { onceDrawn } from "./drawn.js";
import { beginView, passMesh, takeMesh } from "./mesh-relay.js";
import { floorBelow, lookAt } from "./orbit.js";
import { blenderNotice, waitsForBlender } from "./scene-notices.js";
import { keepTurned, meshOf } from "./preview-mesh.js";
import { sideHand } from "./side-hand.js";
import { viewHand } from "./view-hand.js";
import { shapeView } from "./view-request.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../base/types.js").View} View */

const [WIDTH, HEIGHT] = [1280, 720];
/** Up in a mesh that this page has read. @type {Vec3} */
const UP = [0, 1, 0];
/** Duration of the way from one camera to another, in milliseconds. */
const GLIDE_MS = 300;

/** Returns a view between two. @param {View} from @param {View} to @param {number} share from 0 to 1 @returns {View} */
function between(from, to, share) {
  const mixed = (/** @type {Vec3} */ a, /** @type {Vec3} */ b) => /** @type {Vec3} */ (a.map((value, i) => value + share * ((b[i] ?? 0) - value)));
  return { ...to, eye: mixed(from.eye, to.eye), target: mixed(from.target, to.target), up: mixed(from.up, to.up), fov: from.fov + share * (to.fov - from.fov) };
}

/**
 * @param {Scene} scene
 * @param {{element: HTMLElement, line: string, fold: () => boolean}} steps of the preparation, shown over the view
 * @returns {{element: HTMLElement, update: (scene: Scene, step: string) => void, dispose: () => void}}
 */
export function preparingView(scene, steps) {
  /** Not before the page has been drawn. @type {import("./mesh-canvas.js").MeshCanvas | null} */
  let mesh = null;
  const surface = h(
    "div",
    {
      ...{ class: "live-view", tabindex: "0", role: "application" },
      "aria-label": t("The view. Arrows turn it, Shift and arrows move it, plus and minus go nearer and farther; W, A, S, D, Q and E fly."),
    },
  );
  const frame = h("div", { class: "live-view-frame" }, surface);
  shapeView(frame, WIDTH / HEIGHT);
  const picture = examplePictures.get(scene.id);
  if (picture) {
    surface.style.backgroundImage = `url("${picture}")`;
    const image = h("img", { src: picture });
    // Its shape, which mostly is that of the scene's own pictures.
    image.onload = () => isAsked || shapeView(frame, image.naturalWidth / image.naturalHeight);
  }
  /** @type {View | null} */
  let view = null;
  /** What is done until there is something to see. */
  const doing = h("p", { class: "small", "aria-hidden": "true" }); // the list of steps is read out
  /** Whether the view shows the scene. */
  let isSeen = picture !== undefined;
  if (isSeen) steps.fold();
  let words = "";
  const say = () => setText(doing, waiting.hidden ? (isSeen ? steps.line : words || PREPARING) : "");
  const seen = () => {
    isSeen = true;
    steps.fold();
    say();
  };
  let isTurned = false;
  let isAsked = false;
  let letGo = () => {};
  let endWait = () => {};
  let isOpen = true;
  /** @param {View} next */
  const turn = (next) => {
    view = next;
    isTurned = true;
    surface.style.backgroundImage = "";
    if (mesh) {
      mesh.canvas.hidden = false;
      mesh.setView(next);
    }
    keepTurned(scene.id, next);
    standard.update();
  };
  let gliding = 0;
  /** Moves the camera to where the service places it, which may differ a little from where this page did. @param {View} to */
  const glide = (to) => {
    cancelAnimationFrame(gliding);
    const from = view;
    const begun = performance.now();
    const step = () => {
      const share = !from || matchMedia("(prefers-reduced-motion: reduce)").matches ? 1 : Math.min(1, (performance.now() - begun) / GLIDE_MS);
      if (isTurned || !isOpen) return;
      view = share < 1 && from ? between(from, to, share * share * (3 - 2 * share)) : to;
      mesh?.setView(view);
      if (share < 1) gliding = requestAnimationFrame(step);
    };
    step();
  };
  /** Corners of the scene, once they are known. @type {[Vec3, Vec3] | null} */
  let corners = null;
  const standard = sideHand({ view: () => view, side: (name) => corners && sideView(name, corners, latest.cameras.at(-1)?.view.up ?? UP), turn: (next) => turn(next) });
  standard.update();
  /** @param {View} first @param {Vec3} low @param {Vec3} high corners of the scene */
  const follow = (first, low, high) => {
    corners = [low, high];
    standard.update();
    if (!isTurned) glide(first);
    letGo();
    const size = Math.hypot(...high.map((value, i) => value - (low[i] ?? 0))) || 1;
    letGo = viewHand(surface, {
      ...{ view: () => view ?? first, turn, pressed: () => false, keyed: () => false, size },
      floor: () => floorBelow(Boolean(mesh?.hasFloor), latest.cameras.at(-1)?.view.up ?? UP, low, size),
      centre: () => turn(lookAt(view ?? first, /** @type {Vec3} */ (high.map((value, i) => (value + (low[i] ?? 0)) / 2)))),
    });
  };
  let latest = scene;
  beginView(() => {
    if (!isOpen) return;
    const taken = (mesh = takeMesh(scene.id));
    const { canvas } = taken;
    canvas.role = "img";
    canvas.ariaLabel = t("Live picture of the scene");
    canvas.hidden = picture !== undefined && !isTurned;
    surface.append(canvas);
    taken.setScene(latest);
    endWait = onceDrawn(taken, seen);
    // What this page uploaded is drawn until the service has read it.
    void localMeshOf(scene.id).then((local) => {
      if (!local || isAsked || !isOpen) return;
      const { packet, view: first } = local;
      taken.floor ||= "auto"; // what an upload without lights gets
      taken.setMesh(packet);
      follow(first, packet.low, packet.high);
    });
    showPreview(taken);
  });
  /** Shows the service's preview as soon as it has one. @param {import("./mesh-canvas.js").MeshCanvas} on */
  const showPreview = (on) => {
    const { id, preview, cameras, bounds, defaults } = latest;
    const first = cameras[homeCamera(cameras)]?.view;
    const [low, high] = bounds ?? [];
    if (!preview || !first || !low || !high || isAsked) return;
    isAsked = true;
    on.setScene(latest);
    shapeView(frame, (defaults["width"] ?? WIDTH) / (defaults["height"] ?? HEIGHT));
    follow(first, /** @type {Vec3} */ (low), /** @type {Vec3} */ (high));
    meshOf(id).then(
      (packet) => {
        if (isOpen && on.mesh !== packet) on.setMesh(packet);
      },
      () => {}, // the list of steps shows the progress
    );
  };
  const waiting = blenderNotice();
  waiting.hidden = true;
  frame.append(waiting, h("div", { class: "view-pills" }, doing, steps.element, h("div", { class: "view-corner" }, standard.element)));
  return {
    element: h("div", { class: "live-view-box" }, frame),
    /** @param {Scene} next @param {string} step in words */
    update(next, step) {
      waiting.hidden = !waitsForBlender(next);
      words = step;
      say();
      latest = next;
      if (mesh) showPreview(mesh);
    },
    dispose() {
      isOpen = false;
      letGo();
      endWait();
      standard.dispose();
      if (mesh) passMesh(scene.id, mesh);
    },
  };
}
