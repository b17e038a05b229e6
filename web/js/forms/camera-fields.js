/** The camera of a picture: one of the scene's, unchanged or with another lens, one that frames the scene from a side, or a custom one. */

import { h } from "../base/dom.js";
import { field } from "./fields.js";
import { SIDES, sideView } from "./side-views.js";
import { viewFields } from "./view-fields.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("../base/types.js").JobRequest} JobRequest */

/**
 * @typedef {object} CameraFields
 * @property {HTMLElement[]} elements
 * @property {HTMLDetailsElement} lens
 * @property {() => Pick<JobRequest, "camera" | "view">} get
 * @property {() => View} view the complete selected view
 * @property {(view: View) => void} turn to a view of the user's own, or that of a camera, which is chosen then
 * @property {(camera: string | number) => void} choose a camera of the scene, by its name or number
 * @property {(view: View) => void} move the chosen camera, which stays chosen: its scene has moved
 * @property {(distance: number) => void} focus at this distance along the line of sight
 */

const AUTO_CAMERA = "auto"; // a camera that every scene has
const OWN_VIEW = "\0view"; // never the number of a camera
const OF_SIDE = "\0side "; // before the name of a side

/** Returns the number of the camera by which a scene is shown first: the automatic one if the first sees nothing (protocol/contract.py). @param {Scene["cameras"]} cameras */
export const homeCamera = (cameras) => (cameras[0]?.sees_nothing ? cameras.length - 1 : 0);

/**
 * @param {Scene} scene
 * @param {(projection: string) => void} projected the user, or a camera, chose a projection
 * @param {() => number[][] | null} bounds of the scene as it stands
 * @returns {CameraFields}
 */
export function cameraFields({ cameras }, projected, bounds) {
  const camera = h(
    "select",
    null,
    cameras.map(({ name }, number) => h("option", { value: String(number) }, shownName(cameras, name, number))),
    cameras.length > 0 && Object.entries(SIDES).map(([side, { label }]) => h("option", { value: OF_SIDE + side }, label)),
    h("option", { value: OWN_VIEW }, t("Custom view …")),
  );
  const home = homeCamera(cameras);
  camera.value = String(home);
  const view = viewFields(cameras[home]?.view, projected);
  /** The cameras' views as the fields have them, by number, of those that were chosen. */
  const chosenViews = new Map([[home, JSON.stringify(view.get())]]);
  const note = h("p", { class: "quiet small stand-in" }, t("The file's camera sees nothing, so the automatic one is used."));
  const show = () => {
    view.place.hidden = camera.value !== OWN_VIEW;
    note.hidden = home === 0 || camera.value !== String(home);
  };
  camera.addEventListener("change", () => {
    show();
    if (!view.place.hidden) view.place.open = true; // chosen here, it is typed; a turned view seldom is
    const chosen = cameras[Number(camera.value)]; // undefined for a custom view
    if (chosen) {
      view.set(chosen.view); // the starting point of a custom view
      chosenViews.set(Number(camera.value), JSON.stringify(view.get()));
    }
    if (!camera.value.startsWith(OF_SIDE)) return;
    const [corners, up] = [bounds(), cameras.at(-1)?.view.up];
    const side = corners && up && sideView(camera.value.slice(OF_SIDE.length), corners, up);
    if (side) view.set(side);
  });
  show();
  return {
    elements: [field(t("Camera"), camera), note, view.place],
    lens: view.lens,
    get: () => (camera.value === OWN_VIEW || camera.value.startsWith(OF_SIDE) || view.isChanged() ? { view: view.get() } : { camera: asked(cameras, Number(camera.value)) }),
    view: view.get,
    turn(to) {
      const text = JSON.stringify(to);
      const number = cameras.findIndex(({ view: own }, i) => text === JSON.stringify(own) || text === chosenViews.get(i));
      camera.value = number < 0 ? OWN_VIEW : String(number);
      view.set(to);
      show();
    },
    choose(wanted) {
      const number = cameras.findIndex(({ name }, i) => i === wanted || name === wanted);
      if (number < 0) return;
      camera.value = String(number);
      camera.dispatchEvent(new Event("change"));
    },
    move: view.set,
    focus: view.focus,
  };
}

/** Numbers cameras of the same name. @param {Scene["cameras"]} cameras @param {string} name @param {number} number */
function shownName(cameras, name, number) {
  const before = cameras.slice(0, number).filter((other) => other.name === name).length;
  const hasNamesakes = cameras.filter((other) => other.name === name).length > 1;
  if (name === AUTO_CAMERA && number === cameras.length - 1) return t("Automatic: frames the scene");
  return t("{name}, from the file", { name: hasNamesakes ? `${name} (${before + 1})` : name });
}

/**
 * A camera's name if it is unambiguous; a shared name refers to the first such camera.
 * @param {Scene["cameras"]} cameras
 * @param {number} number
 */
function asked(cameras, number) {
  const name = cameras[number]?.name;
  return name !== undefined && cameras.findIndex((other) => other.name === name) === number ? name : number;
}
