/**
 * What a live view shows until its picture is clear: an earlier picture, the preview mesh, or after a change the last denoised picture,
 * projected for the new camera. The canvas is held back meanwhile, which css/workspace.css hides.
 */

import { isBlack } from "../base/black-image.js";
import { h } from "../base/dom.js";
import { examplePictures } from "../news/example-pictures.js";
import { localMeshOf } from "../news/local-mesh.js";
import { meshOf } from "./preview-mesh.js";
import { meshPicture } from "./view-pictures.js";

/** @typedef {import("../base/types.js").View} View */

/** The camera of a request, and its light as JSON. @typedef {{view: View, light: string}} Requested */

/**
 * A picture to show until the view's first picture arrives. One that is finished, or of a view of which denoised pictures come, stays
 * until the view is denoised or has some samples per pixel, or something else is requested.
 *
 * @typedef {object} Meanwhile
 * @property {string} url "": none
 * @property {string} nearest the same picture, smaller, which the page has loaded before; "": none
 * @property {boolean} isFinished
 * @property {boolean} isSame whether it is of the same view
 * @property {{element: HTMLElement, isOpen: boolean, follow: (samples: number, all: number, message: string, denoises: boolean) => void, end: () => void}} steps of an upload, shown until the first picture
 * @property {boolean} [isClear] whether it was this very view, or the scene's poster, when it was clear
 */

const HELD_BACK = "held-back";

/** Samples per pixel after which a view that is never denoised replaces a finished picture; and the preview mesh. */
const [CLEAN_SPP, MESH_SPP] = [8, 1];
/**
 * Time, in milliseconds, that a view of MESH_SPP samples is awaited denoised, less where what is shown has another light, and samples per
 * pixel that end the wait: noise must not follow a clean picture.
 */
const [DENOISED_MS, RELIT_MS, DENOISED_SPP] = [15_000, 2000, 64];
/** Time, in milliseconds, after which what lies under the first picture is removed: it has been drawn and faded in. */
const COVERED_MS = 500;
/** Part of the view's width that a denoised picture must have to replace the preview mesh. */
const FINE_SHARE = 0.75;
/** Samples per pixel with which a denoised picture replaces a picture of itself that was clear. */
const POSTER_SPP = 16;
/** Samples per pixel after which a view is clear enough to be kept, and one that is not denoised replaces a preview mesh, a thumbnail or nothing: fewer are noise. */
export const SHARP_SPP = 4;
/** Samples per pixel from which a denoised picture replaces the sharp preview mesh, which looks better than those of fewer. */
export const CLEAR_SPP = 8;
/** Time, in milliseconds, after which SHARP_SPP samples replace it; and after which any replace a kept picture in the same light. */
const [ROUGH_MS, KEPT_MS] = [3000, 3000];
/** Distance of the cameras, of 1, from which the kept picture shows little of the view. */
const POOR = 0.6;

/** @param {View} view */
export const projectionOf = ({ projection }) => projection ?? "perspective";

/** @param {View} a @param {View} b */
const isEqual = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** Returns whether a picture of one camera can be shown for another. @param {View} from @param {View} to */
const canKeep = (from, to) => isEqual(from, to) || (projectionOf(from) === projectionOf(to) && from.projection !== "panorama");

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
    this.picture = picture;
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
    /** The first request, and the same without its camera. @type {{text: string, scene: string} | null} */
    this.first = null;
    /** Whether the latest request shows another scene than the first one: the preview mesh shows only that. */
    this.isChanged = false;
    /** Light of the first request. @type {string | undefined} */
    this.firstLight = undefined;
    /** Light of the kept picture. @type {string | undefined} */
    this.keptLight = undefined;
    /** The clear picture that is shown first, and its camera. @type {{image: HTMLImageElement, view: View} | null} */
    this.below = null;
    /** When the view had MESH_SPP samples per pixel; 0: not yet. */
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

  /** Whether what is shown has a black background, and nothing but what the mesh has is seen: the mesh itself, or a black thumbnail of the scene. */
  get isBlackBehind() {
    const { mesh } = this.mesh;
    if (this.isThumbnailBlack && this.isInstead && !this.isMeshShown) return true;
    return this.isMeshShown && !this.hasKept && mesh !== null && !mesh.environment && !mesh.isStudio;
  }

  /** Whether a picture is projected onto the mesh. */
  get hasKept() {
    return this.mesh.kept !== null;
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
    if (isBelow && mesh.mesh) {
      mesh.keep(below.image, below.view);
      this.keptLight = this.firstLight;
    }
    this.surface.style.backgroundImage = "";
    this.canvas.classList.add(HELD_BACK); // the first samples are coarser than the mesh
  }

  /** Turns the mesh to the present camera. */
  follow() {
    if (this.isCovered) this.mesh.setView(this.view());
  }

  /** Compares a request with the first one, and shows the canvas in place of a picture of another view. @param {Record<string, any>} request */
  compare(request) {
    const text = JSON.stringify(request);
    const { view, camera, width, height, ...others } = request; // the order of keys changes as the camera turns
    const scene = JSON.stringify(others);
    this.first ??= { text, scene };
    this.firstLight ??= JSON.stringify(request["environment"] ?? null);
    if (text !== this.first.text && !this.isMeshShown) this.release();
    this.isChanged ||= scene !== this.first.scene;
  }

  /** Shows the canvas in place of the mesh, which does not show a new light. */
  relight() {
    if (!this.hasKept) this.release();
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
    meshOf(scene.id).then((packet) => this.isDisposed || mesh.mesh || mesh.setMesh(packet), () => {});
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
   * Keeps the canvas's denoised picture on the page after a change, projected for the new camera, until the new one is denoised.
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
    this.keep(shown);
    this.canvas.classList.add(HELD_BACK);
  }

  /** Projects the canvas's picture for the present camera until another is clear. @param {Requested} shown its request */
  keep({ view, light }) {
    this.picture.draw(); // WebGL keeps its picture only until the next frame
    this.mesh.keep(this.canvas, view);
    this.keptLight = light;
  }

  /**
   * Projects a denoised picture of an earlier request in place of the kept one, where it is better: in another light of the same camera,
   * or if the kept one shows little of the view.
   *
   * @param {Requested | undefined} shown the request of the picture
   */
  keepNewer(shown) {
    const { mesh } = this;
    if (!shown || !this.hasKept || !this.isMeshShown || !this.isHeld || !canKeep(shown.view, this.view())) return;
    if (mesh.distance === 0 ? isEqual(shown.view, this.view()) : mesh.distance >= POOR) this.keep(shown);
  }

  /**
   * Shows the canvas if its picture has become clear enough to replace what is shown.
   *
   * @param {object} state of the picture
   * @param {number} state.mean samples per pixel
   * @param {number} state.shown those of the picture: a denoised one may have fewer than the view has by now
   * @param {boolean} state.done
   * @param {boolean} state.denoised
   * @param {boolean} state.isLatest whether it is of the latest request
   * @param {number} state.share of the view's width that the picture has
   * @param {string} state.light of the latest request
   * @param {Requested | undefined} shown the request of the picture
   */
  judge({ mean, shown: spp, done, denoised, isLatest, share, light }, shown) {
    const { mesh, meanwhile, hasKept } = this;
    this.sampledAt = mean < MESH_SPP ? 0 : this.sampledAt || performance.now(); // another view begins anew
    const waited = this.sampledAt && performance.now() - this.sampledAt;
    const patience = hasKept && this.keptLight !== light ? RELIT_MS : DENOISED_MS;
    const isDenoisedSoon = this.willBeDenoised() && waited <= patience;
    const isCleanBelow = meanwhile.isFinished && !this.isMeshShown;
    // The preview mesh is sharp: what replaces it must be as fine, and not smeared by denoising few samples.
    const isMeshTrue = !hasKept && this.isMeshShown && !this.isChanged;
    const isSharp = (done && spp >= mean) || this.isDue(spp, waited, light);
    const isEmptyBelow = !this.isMeshShown && !this.surface.style.backgroundImage;
    const isEnough = spp >= (isEmptyBelow ? SHARP_SPP : isDenoisedSoon ? DENOISED_SPP : isCleanBelow ? CLEAN_SPP : hasKept ? MESH_SPP : SHARP_SPP);
    // A small picture replaces the kept one only where that is of the same camera, or shows little of the view.
    const isFine = share >= FINE_SHARE || (hasKept && this.isMeshShown && [0, 1].includes(mesh.distance));
    const isReady = (done && !isDenoisedSoon) || (denoised && isFine && isSharp) || (isEnough && (isFine || !isMeshTrue));
    if (isReady && (isLatest || !hasKept)) this.release();
    else if (denoised) this.keepNewer(shown);
  }

  /**
   * Returns whether a denoised picture has enough samples to replace what is shown.
   *
   * @param {number} spp samples per pixel of the picture
   * @param {number} waited since the view has samples, in milliseconds
   * @param {string} light of the latest request
   */
  isDue(spp, waited, light) {
    // A picture of the same camera is kept where something else has changed, which is to be seen. The guides of few samples have noise.
    if (this.hasKept) return this.mesh.distance === 0 || this.keptLight !== light || spp >= SHARP_SPP || waited > KEPT_MS;
    if (this.isMeshShown && !this.isChanged) return spp >= CLEAR_SPP || (waited > ROUGH_MS && spp >= SHARP_SPP);
    const isClearBelow = !this.isMeshShown && this.meanwhile.isFinished && Boolean(this.meanwhile.isClear);
    return !isClearBelow || spp >= POSTER_SPP;
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
    if (this.isChanged) return 0;
    return !this.hasKept ? SHARP_SPP : mesh.distance === 0 ? POSTER_SPP : 0;
  }

  dispose() {
    this.isDisposed = true;
    clearTimeout(this.uncovering);
    this.mesh.dispose();
  }
}
