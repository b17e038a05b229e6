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
 * @property {(view: View) => void} turn to a view of the user's own, or that of a camera or side, which is chosen then
 * @property {(side: string) => View | null} side returns the view that frames the scene from a side; null while its extent is unknown
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
  /** The views of chosen cameras and sides as the fields have them, by the values of their options. */
  const chosenViews = new Map([[String(home), JSON.stringify(view.get())]]);
  /** @param {string} name */
  const side = (name) => {
    const [corners, up] = [bounds(), cameras.at(-1)?.view.up];
    return corners && up ? sideView(name, corners, up) : null;
  };
  const note = h("p", { class: "quiet small stand-in" }, t("The file's camera sees nothing, so the automatic one is used."));
  const show = () => {
    view.place.hidden = camera.value !== OWN_VIEW;
    note.hidden = home === 0 || camera.value !== String(home);
  };
  camera.addEventListener("change", () => {
    show();
    if (!view.place.hidden) view.place.open = true; // chosen here, it is typed; a turned view seldom is
    const isSide = camera.value.startsWith(OF_SIDE);
    const chosen = isSide ? side(camera.value.slice(OF_SIDE.length)) : cameras[Number(camera.value)]?.view;
    if (chosen) choose(camera.value, chosen);
  });
  show();
  /** Shows a camera's or side's view in the fields, from which a custom view starts. @param {string} option its value @param {View} of */
  const choose = (option, of) => {
    view.set(of);
    chosenViews.set(option, JSON.stringify(view.get()));
  };
  return {
    elements: [field(t("Camera"), camera), note, view.place],
    lens: view.lens,
    get: () => (camera.value === OWN_VIEW || camera.value.startsWith(OF_SIDE) || view.isChanged() ? { view: view.get() } : { camera: asked(cameras, Number(camera.value)) }),
    view: view.get,
    turn(to) {
      const text = JSON.stringify(to);
      const number = cameras.findIndex(({ view: own }, i) => text === JSON.stringify(own) || text === chosenViews.get(String(i)));
      const ofSide = number < 0 && Object.keys(SIDES).find((name) => text === JSON.stringify(side(name)) || text === chosenViews.get(OF_SIDE + name));
      camera.value = number >= 0 ? String(number) : ofSide ? OF_SIDE + ofSide : OWN_VIEW;
      if (ofSide) choose(camera.value, to);
      else view.set(to);
      show();
    },
    side,
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
