/** The camera of a picture: one of the scene's, as it is or with another lens, or one by numbers. */

import { h } from "./dom.js";
import { field } from "./fields.js";
import { viewFields } from "./view-fields.js";

/** @typedef {import("./types.js").Scene} Scene */
/** @typedef {import("./types.js").View} View */
/** @typedef {import("./types.js").JobRequest} JobRequest */

/**
 * @typedef {object} CameraFields
 * @property {HTMLElement[]} elements
 * @property {() => Pick<JobRequest, "camera" | "view">} get
 * @property {() => View} view what is chosen, in full
 * @property {(view: View) => void} turn to a view of the user's own
 * @property {(distance: number) => void} focus at this distance along the line of sight
 */

const AUTO_CAMERA = "auto"; // the one that every scene has
const OWN_VIEW = "\0view"; // no camera's name has a NUL in it

/**
 * @param {Scene} scene
 * @param {(projection: string) => void} projected the user, or a camera, chose a projection
 * @returns {CameraFields}
 */
export function cameraFields({ cameras }, projected) {
  const camera = h(
    "select",
    null,
    cameras.map(({ name }) =>
      h("option", { value: name }, name === AUTO_CAMERA ? "Automatic: frames the scene" : name),
    ),
    h("option", { value: OWN_VIEW }, "Custom view …"),
  );
  const view = viewFields(cameras[0]?.view, projected);
  const show = () => (view.place.hidden = camera.value !== OWN_VIEW);
  camera.addEventListener("change", () => {
    show();
    const chosen = cameras.find(({ name }) => name === camera.value);
    if (chosen) view.set(chosen.view); // where a view of one's own then starts
  });
  show();
  return {
    elements: [field("Camera", camera), view.place, view.lens],
    get: () => (camera.value === OWN_VIEW || view.isChanged() ? { view: view.get() } : { camera: camera.value }),
    view: view.get,
    turn(to) {
      camera.value = OWN_VIEW;
      view.set(to);
      show();
    },
    focus: view.focus,
  };
}
