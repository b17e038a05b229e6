/**
 * What a live view shows until its picture is clear: an earlier picture, the preview mesh, or after a change the last denoised picture,
 * projected for the new camera. The canvas is held back meanwhile, which css/workspace.css hides.
 */

import { isBlack } from "../base/black-image.js";
import { h } from "../base/dom.js";
import { examplePictures } from "../news/example-pictures.js";
import { localMeshOf } from "../news/local-mesh.js";
import { meshOf } from "./preview-mesh.js";
import { Projection, canKeep } from "./projection.js";
import { POSTER_SPP, SHARP_SPP, replaces } from "./replacement.js";
import { RequestedScene, isSameUnlit } from "./requested-scene.js";
import { keyOf } from "./chosen-light.js";
import { SentLights } from "./sent-light.js";
import { meshPicture } from "./view-pictures.js";

/** @typedef {import("../base/types.js").View} View */

/** @typedef {import("./requested-scene.js").Requested} Requested */

/**
 * A picture to show until the view's first picture arrives. One that is finished, or of a view of which denoised pictures come, stays
 * until the view is denoised or has some samples per pixel, or something else is requested.
 *
 * @typedef {object} Meanwhile
 * @property {string} url "": none
 * @property {string} nearest the same picture, smaller, which the page has loaded before; "": none
 * @property {boolean} isFinished
 * @property {boolean} isSame whether it is of the same view
 * @property {{element: HTMLElement, isOpen: boolean, line: string, fold: () => boolean, follow: (part: number, message: string, denoises: boolean) => void, end: () => void}} steps of an upload, shown until the first picture
 * @property {boolean} [isClear] whether it was this very view, or the scene's poster, when it was clear
 */

const HELD_BACK = "held-back";

/** Time, in milliseconds, after which what lies under the first picture is removed: it has been drawn and faded in. */
const COVERED_MS = 700;
export class Cover {
  /**
   * @param {import("../base/types.js").Scene} scene
   * @param {Meanwhile} meanwhile
   * @param {object} page
   * @param {HTMLElement} page.surface around the canvases
   * @param {HTMLCanvasElement} page.canvas of the picture
   * @param {import("../film/film-canvas.js").FilmCanvas} page.picture
   * @param {import("./mesh-canvas.js").MeshCanvas} page.mesh
   * @param {() => View} page.view the present camera
   * @param {() => void} page.laid called when the mesh or picture that was awaited is shown
   * @param {() => boolean} page.willBeDenoised whether denoised pictures of the view come
   */
  constructor(scene, meanwhile, { surface, canvas, picture, mesh, view, laid, willBeDenoised }) {
    this.scene = scene;
    this.meanwhile = meanwhile;
    this.surface = surface;
    this.canvas = canvas;
    this.mesh = mesh;
    this.view = view;
    this.laid = laid;
    this.willBeDenoised = willBeDenoised;
    /** Whether a picture or draft of the view has arrived. */
    this.isSampled = false;
    /** Whether anything is shown under the canvas. */
    this.isCovered = true;
    this.isDisposed = false;
    /** Whether the picture that is shown first is known to be black. */
    this.isThumbnailBlack = false;
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.uncovering = undefined;
    this.requested = new RequestedScene();
    this.projection = new Projection({ surface, canvas, picture, mesh, view });
    this.lights = new SentLights(scene.id, () => this.relight());
    /** Whether the mesh shows the scene and the light of the latest request. */
    this.isMeshTrue = true;
    /** The clear picture that is shown first, and its camera. @type {{image: HTMLImageElement, view: View} | null} */
    this.below = null;
    /** When the view had a sample per pixel; 0: not yet. */
    this.sampledAt = 0;
    mesh.setScene(scene);
    this.begin();
  }

  begin() {
    const { scene, surface, canvas } = this;
    const { url, nearest, isFinished, isSame, isClear } = this.meanwhile;
    // A mesh that is on the page already stays; else a rendered picture of the same view is truer than the mesh.
    // A thumbnail is blurred at the view's size: the mesh, which is sharp, replaces it as soon as it is drawn.
    const isMeshFirst = !url || (!isFinished && (!isSame || Boolean(scene.preview))) || (!isClear && this.mesh.mesh !== null && url !== examplePictures.get(scene.id));
    canvas.classList.toggle(HELD_BACK, isMeshFirst && !isSame ? this.willBeDenoised() : isFinished || isSame);
    const hasAlpha = url.includes("/image.png"); // as thumbnailFormat requests a transparent background
    surface.classList.toggle("has-alpha", hasAlpha);
    const below = [url, nearest].filter(Boolean).map((each) => `url("${each}")`);
    if (hasAlpha) below.push("var(--squares-image)");
    surface.style.backgroundImage = below.join(", ");
    if (isMeshFirst) this.showMesh();
    else if (isSame && url) void this.lookAt(url);
  }

  /** Finds out whether the picture of the view that is shown first is black, and keeps it for the first turn of the camera. @param {string} url */
  async lookAt(url) {
    const image = h("img", { src: url });
    const view = this.view();
    try {
      await image.decode();
    } catch {
      return; // it was deleted meanwhile, or the page is left
    }
    if (this.isDisposed) return;
    this.isThumbnailBlack = isBlack(image);
    this.laid();
    if (!this.meanwhile.isClear) return;
    this.below = { image, view };
    this.loadMesh();
  }

  /** Whether the canvas is held back. */
  get isHeld() {
    return this.canvas.classList.contains(HELD_BACK);
  }

  /** Whether something is shown in place of the canvas. */
  get isInstead() {
    return this.isCovered && this.isHeld;
  }

  get isMeshShown() {
    return !this.mesh.canvas.hidden;
  }

  /** Whether the mesh is shown as the latest request wants it, without a picture that is projected onto it. */
  get isMeshAlone() {
    return this.isMeshShown && this.isMeshTrue && !this.hasKept && this.mesh.mesh !== null && !this.isOutdated;
  }

  /** Whether what is shown has a black background, and nothing but what the mesh has is seen: the mesh itself, or a black thumbnail of the scene. */
  get isBlackBehind() {
    const { mesh } = this.mesh;
    if (this.isThumbnailBlack && this.isInstead && !this.isMeshShown) return true;
    const { light } = this.requested;
    return this.isMeshShown && this.isMeshTrue && !this.hasKept && mesh !== null && !mesh.environment && !mesh.isStudio && !light.color && !keyOf(light);
  }

  /** Whether a picture is projected onto the mesh. */
  get hasKept() {
    return this.projection.isOn;
  }

  /** Shows the preview mesh until samples arrive, at once if the scene was drawn while it was prepared. */
  showMesh() {
    const { scene, mesh } = this;
    if (this.isSampled && !this.isHeld) return;
    if (mesh.mesh) this.layMesh();
    if (!scene.preview) return;
    /** @param {import("../news/mesh-packet.js").MeshPacket} packet */
    const show = async (packet) => {
      const isOver = () => (this.isSampled && !this.isHeld) || this.isDisposed;
      if (isOver() || mesh.mesh === packet) return;
      mesh.setMesh(packet);
      this.lights.want(packet, this.requested.request);
      await mesh.ready; // what is under it stays meanwhile
      if (isOver()) return;
      this.layMesh();
      this.laid();
    };
    void localMeshOf(scene.id).then((local) => void (local && !mesh.mesh && show(local.packet)));
    meshOf(scene.id).then(show, () => {}); // the samples come without it
  }

  layMesh() {
    const { below, mesh } = this;
    const isBelow = below !== null && this.surface.style.backgroundImage !== "" && canKeep(below.view, this.view());
    mesh.setView(this.view());
    mesh.canvas.hidden = false;
    this.isMeshTrue = this.lightMesh();
    const { first, isChanged } = this.requested;
    if (isBelow && mesh.mesh && !(isChanged && this.isMeshTrue)) this.projection.keepImage(below.image, below.view, first);
    this.surface.style.backgroundImage = "";
    this.canvas.classList.add(HELD_BACK); // the first samples are coarser than the mesh
  }

  /** Lights the mesh as the latest request chooses. Returns whether it then shows the scene and the light of that request. */
  lightMesh() {
    const isLit = this.mesh.relight(this.requested.light);
    const { first, latest, isChanged } = this.requested;
    return !isChanged || (isLit && isSameUnlit(latest, first));
  }

  /** Turns the mesh to the present camera. */
  follow() {
    if (!this.isCovered) return;
    this.mesh.setView(this.view());
    this.projection.follow(() => this.rest());
  }

  /** Shows the sharp mesh in place of a picture that is stretched over it, or smaller than the view. */
  rest() {
    if (!this.hasKept || !this.isHeld || !this.isMeshTrue) return;
    if (this.isOutdated || !this.projection.isSharp) this.projection.fade();
  }

  /** What is shown, as `sceneOf` returns it of a request. */
  get shownScene() {
    const { first, latest } = this.requested;
    if (this.hasKept) return this.projection.scene;
    return this.isMeshShown && this.isMeshTrue ? latest : first;
  }

  /** Whether what is shown differs from the latest request in more than the camera. */
  get isOutdated() {
    return this.shownScene !== this.requested.latest;
  }

  /** Whether the light is the only such difference. */
  get isOtherLight() {
    return this.isOutdated && isSameUnlit(this.shownScene, this.requested.latest);
  }

  /** Takes a request: shows the canvas in place of a picture of another camera, and the mesh in a new light. @param {Record<string, any>} request */
  compare(request) {
    const isFirst = !this.requested.latest;
    const { isMoved, isOther } = this.requested.take(request);
    if (isMoved && !this.isMeshShown) this.release();
    if (!isOther) return;
    this.lights.want(this.mesh.mesh, request);
    this.isMeshTrue = this.lightMesh();
    if (!isFirst) this.showLight();
  }

  /** Shows the mesh in the light of the latest request, if it has it, in place of what has another one. */
  showLight() {
    if (!this.isInstead || !this.isMeshTrue || !this.mesh.mesh) return;
    if (this.hasKept) this.projection.fade();
    else if (!this.isMeshShown) this.layMesh();
  }

  /** Takes note that the light of the latest request has arrived. */
  relight() {
    if (this.isDisposed) return;
    const wasTrue = this.isMeshTrue;
    this.isMeshTrue = this.lightMesh();
    if (!wasTrue) this.showLight();
    this.laid();
  }

  /** Takes note that a picture or draft has arrived. @returns {boolean} whether it is the first one */
  sampled() {
    const isFirst = !this.isSampled;
    this.isSampled = true;
    if (isFirst) this.loadMesh();
    if (!this.isHeld) this.uncoverSoon();
    return isFirst;
  }

  /** Shows a draft in place of the mesh, if drafts are smoothed: they are of the present camera, and have the scene's own light. */
  drafted() {
    if (this.isMeshShown && this.willBeDenoised()) this.release();
  }

  /** Loads the mesh for the next turn of the camera, if the view began with a picture instead. */
  loadMesh() {
    const { scene, mesh } = this;
    if (mesh.mesh || !scene.preview || this.isDisposed) return;
    meshOf(scene.id).then((packet) => {
      if (this.isDisposed || mesh.mesh) return;
      mesh.setMesh(packet);
      this.lights.want(packet, this.requested.request);
    }, () => {});
  }

  /** Shows the canvas, and soon removes what is under it. */
  release() {
    this.canvas.classList.remove(HELD_BACK);
    if (this.isSampled) this.uncoverSoon();
  }

  uncoverSoon() {
    if (this.isCovered) this.uncovering ??= setTimeout(() => this.uncover(), COVERED_MS);
  }

  uncover() {
    this.uncovering = undefined;
    if (this.isHeld) return;
    if (Number(getComputedStyle(this.canvas).opacity) < 1) return this.uncoverSoon(); // a busy machine fades late
    this.isCovered = false;
    this.surface.style.backgroundImage = "";
    this.mesh.canvas.hidden = true;
    this.mesh.release();
  }

  /**
   * Keeps the canvas's denoised picture on the page after a change, projected for the new camera, until the new one is denoised; or shows
   * the mesh, if it has the new light.
   *
   * @param {Requested | undefined} shown the request of the picture
   */
  hold(shown) {
    const { mesh } = this;
    if (!shown || this.isHeld || !this.willBeDenoised() || !mesh.mesh || !canKeep(shown.view, this.view())) return;
    clearTimeout(this.uncovering);
    this.uncovering = undefined;
    this.isCovered = true;
    mesh.canvas.hidden = false;
    mesh.setView(this.view());
    this.projection.keep(shown);
    this.canvas.classList.add(HELD_BACK);
    this.isMeshTrue = this.lightMesh(); // it may have been loaded since the request
    if (this.isOutdated && this.isMeshTrue) this.projection.fade();
  }

  /** What is shown in place of the canvas. @returns {import("./replacement.js").Shown} */
  get shown() {
    if (this.isMeshShown) return this.hasKept ? "projected" : "mesh";
    if (!this.surface.style.backgroundImage) return "nothing";
    return this.meanwhile.isFinished ? "clear" : "thumbnail";
  }

  /**
   * Shows the canvas if its picture has become clear enough to replace what is shown.
   *
   * @param {Omit<import("./replacement.js").Facts, "shown" | "isOutdated" | "isPoor" | "waited"> & {mean: number}} picture mean: samples per pixel that the view has by now
   * @param {Requested | undefined} shown the request of the picture
   */
  judge(picture, shown) {
    this.sampledAt = picture.mean < 1 || !picture.isLatest ? 0 : this.sampledAt || performance.now(); // another view begins anew
    const waited = this.sampledAt && performance.now() - this.sampledAt;
    const { isOutdated, projection } = this;
    if (replaces({ ...picture, shown: this.shown, isOutdated, isPoor: projection.isPoor, waited })) this.release();
    else if (picture.isDenoised && shown && this.hasKept && this.isMeshShown && this.isHeld) projection.keepNewer(shown);
  }

  /** Returns the URL of what is shown in place of the canvas; "" if nothing is. */
  pictureUrl() {
    if (!this.isInstead) return "";
    return this.isMeshShown ? meshPicture(this.mesh) : this.meanwhile.url;
  }

  /** Returns the samples per pixel of a denoised picture that looks as good as what is shown in place of the canvas; 0 if that shows another camera or light. */
  worth() {
    const { meanwhile, mesh } = this;
    if (!this.isMeshShown) return meanwhile.isClear ? POSTER_SPP : meanwhile.isFinished && meanwhile.isSame ? SHARP_SPP : 0;
    if (!this.isMeshTrue || this.isOutdated) return 0;
    return !this.hasKept ? SHARP_SPP : mesh.distance === 0 ? POSTER_SPP : 0;
  }

  dispose() {
    this.isDisposed = true;
    clearTimeout(this.uncovering);
    this.projection.dispose();
    this.lights.dispose();
    this.mesh.dispose();
  }
}
