/** A picture without noise that a live view projects onto the preview mesh, for the present camera, until its own picture is clear. */

import { h } from "../base/dom.js";
import { staysSharp } from "./replacement.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("./requested-scene.js").Requested} Requested */

/** Time, in milliseconds, for which the camera rests before the sharp mesh replaces the picture; and in which it does. */
const [REST_MS, FADE_MS] = [150, 150];
/** Distance of the cameras, of 1, from which the picture shows little of the view. */
const POOR = 0.6;

/** @param {View} view */
export const projectionOf = ({ projection }) => projection ?? "perspective";

/** @param {View} a @param {View} b */
const isEqual = (a, b) => JSON.stringify(a) === JSON.stringify(b);

/** Returns whether a picture of one camera can be shown for another. @param {View} from @param {View} to */
export const canKeep = (from, to) => isEqual(from, to) || (projectionOf(from) === projectionOf(to) && from.projection !== "panorama");

export class Projection {
  /**
   * @param {object} page
   * @param {HTMLElement} page.surface around the canvases
   * @param {HTMLCanvasElement} page.canvas of the picture
   * @param {import("../film/film-canvas.js").FilmCanvas} page.picture
   * @param {import("./mesh-canvas.js").MeshCanvas} page.mesh
   * @param {() => View} page.view the present camera
   */
  constructor({ surface, canvas, picture, mesh, view }) {
    this.surface = surface;
    this.canvas = canvas;
    this.picture = picture;
    this.mesh = mesh;
    this.view = view;
    /** What the picture shows, as sceneOf returns it. */
    this.scene = "";
    /** Runs until the camera has rested for REST_MS. @type {ReturnType<typeof setTimeout> | undefined} */
    this.resting = undefined;
  }

  get isOn() {
    return this.mesh.kept !== null;
  }

  /** Whether the picture shows next to nothing of the view. */
  get isPoor() {
    return this.isOn && this.mesh.distance === 1;
  }

  /** Projects the canvas's picture. @param {Requested} shown its request */
  keep({ view, scene }) {
    this.picture.draw(); // WebGL keeps its picture only until the next frame
    this.keepImage(this.canvas, view, scene);
  }

  /** @param {HTMLCanvasElement | HTMLImageElement} image @param {View} view its camera @param {string} scene what it shows */
  keepImage(image, view, scene) {
    this.mesh.keep(image, view);
    this.scene = scene;
  }

  /** Projects the canvas's picture in place of the present one, where it is better: of the same camera, or if that shows little of the view. @param {Requested} shown its request */
  keepNewer(shown) {
    const { distance } = this.mesh;
    if (!canKeep(shown.view, this.view())) return;
    if (distance === 0 ? isEqual(shown.view, this.view()) : distance >= POOR) this.keep(shown);
  }

  /** Follows the camera. @param {() => void} rest called when it rests, or the picture shows little */
  follow(rest) {
    clearTimeout(this.resting);
    if (!this.isOn) return;
    if (this.mesh.distance >= POOR) rest();
    else this.resting = setTimeout(rest, REST_MS);
  }

  /** Whether the picture is as sharp as the mesh. */
  get isSharp() {
    const { distance, kept } = this.mesh;
    return kept !== null && staysSharp(distance, kept.width / this.canvas.clientWidth);
  }

  /** Fades the picture out, and shows the mesh itself. */
  fade() {
    const { mesh, surface } = this;
    mesh.draw(); // WebGL keeps its picture only until the next frame
    const still = h("canvas", { class: "fading", width: mesh.canvas.width, height: mesh.canvas.height, ariaHidden: "true" });
    still.getContext("2d")?.drawImage(mesh.canvas, 0, 0);
    surface.append(still);
    mesh.release();
    mesh.draw();
    still.animate({ opacity: [1, 0] }, { duration: FADE_MS, fill: "forwards" });
    setTimeout(() => still.remove(), FADE_MS);
  }

  dispose() {
    clearTimeout(this.resting);
  }
}
