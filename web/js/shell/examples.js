/** Opens example scenes, which the service makes scenes of when they are opened. */

import { getExamples, openExample } from "../news/api.js";
import { examplePictures } from "../news/example-pictures.js";
import { adoptScene } from "../news/farm.js";
import { t } from "../base/words.js";
import { linkTo } from "./router.js";
import { showError } from "./tray.js";

/** @typedef {import("../base/types.js").Example} Example */

/** The picture of an example, rendered by Rayfarm; not every example has one. @param {Example} example */
export const pictureOf = ({ name }) => new URL(`../../examples/${encodeURIComponent(name)}.jpg`, import.meta.url).href;

/** Settles once the scenes of the examples are known, or cannot be listed. @type {Promise<unknown> | null} */
let known = null;

/** Lists the examples, and keeps the pictures of the scenes that were opened from them. */
export function listExamples() {
  const listed = getExamples().then((examples) => {
    for (const example of examples) for (const id of example.scenes) examplePictures.set(id, pictureOf(example));
    return examples;
  });
  known ??= listed.catch(() => {});
  return listed;
}

/** Settles once the page has tried to learn which scenes were opened from examples. */
export async function knowExamples() {
  if (!known) void listExamples().catch(() => {});
  await known;
}

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
