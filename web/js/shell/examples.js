/** Opens example scenes, which the service makes scenes of when they are opened. */

import { openExample } from "../news/api.js";
import { examplePictures } from "../news/example-pictures.js";
import { adoptScene } from "../news/farm.js";
import { t } from "../base/words.js";
import { linkTo } from "./router.js";
import { showError } from "./tray.js";

/** @typedef {import("../base/types.js").Example} Example */

/** The picture of an example, rendered by Rayfarm; not every example has one. @param {Example} example */
export const pictureOf = ({ name }) => new URL(`../../examples/${encodeURIComponent(name)}.jpg`, import.meta.url).href;

/** Opens the page of an example's scene. @param {Example} example */
export async function visitExample(example) {
  try {
    const scene = await openExample(example.name);
    examplePictures.set(scene.id, pictureOf(example));
    adoptScene(scene);
    location.hash = linkTo("scenes", scene.id) + (example.frames ? "?shot" : "");
  } catch (error) {
    showError(t("{title} could not be opened", { title: example.title }), error);
  }
}
