/** Dropping and choosing files: from the drop to the scene's page, with a card in the tray on the way. */

import { ApiError, deleteScene, getInfo } from "../news/api.js";
import { fill, h, setText } from "../base/dom.js";
import { adoptScene, scenes } from "../news/farm.js";
import { bytes } from "../base/format.js";
import { chosenProject } from "../base/project.js";
import { filesOfDrop, filesOfList, titleOf } from "./gather-files.js";
import { icon } from "../base/icons.js";
import { areImages, hasLight, offerLight } from "./light-drop.js";
import { addEnvironment } from "../news/environments.js";
import { said } from "../base/said.js";
import { mayChange } from "../news/projects.js";
import { go, here } from "./router.js";
import { Card, announce, showError } from "./tray.js";
import { upload } from "../news/upload.js";
import { filesFor, rivals, whichScene } from "./which-scene.js";
import { t } from "../base/words.js";

/** @typedef {import("./gather-files.js").NamedFile} NamedFile */
/** @typedef {import("../base/types.js").Scene} Scene */

/** What a sentence says of a scene that lacks a file. */
export const LACKS = /; add (it|them)/;

/** @param {NamedFile[]} files */
async function start(files) {
  if (!files.length) {
    const { formats } = await getInfo();
    showError(t("Nothing to upload"), t("There was no file in what you dropped. A scene is one of {formats}.", { formats: formats.join(" ") }));
    return;
  }
  const sent = files.map(({ file }) => file);
  const lacking = sceneThatLacks(sent);
  if (lacking) {
    await add(lacking, files);
    return;
  }
  if (areImages(sent)) {
    if (!offerLight(sent)) explainImages(sent);
    return;
  }
  const { formats, foreign } = await getInfo();
  const paths = files.map(({ path }) => path.toLowerCase());
  if (!paths.some((path) => formats.some((suffix) => path.endsWith(suffix)))) {
    for (const [suffix, advice] of Object.entries(foreign)) {
      const at = paths.findIndex((path) => path.endsWith(suffix));
      if (at < 0) continue;
      showError(t("{path} cannot be read here", { path: files[at]?.path ?? "" }), advice.startsWith("Unpack") ? `${said(advice)}.` : t("{advice}; drop what that writes.", { advice: said(advice) }));
      return;
    }
  }
  const mains = paths.some((path) => path.endsWith(".zip")) ? [] : rivals(files, formats);
  if (mains.length < 2) {
    const scene = await send(files);
    if (scene) go("scenes", scene.id);
    return;
  }
  const chosen = await whichScene(mains);
  for (const main of chosen) {
    const scene = await send(filesFor(files, main), { main });
    if (scene && chosen.length === 1) go("scenes", scene.id);
  }
}

/**
 * Gives a scene the files that it lacks, or others in place of those of the same names.
 *
 * @param {Scene} base
 */
export function addFiles(base) {
  pick({ folder: false }, (files) => add(base, files));
}

/** @param {Scene} base @param {NamedFile[]} files */
async function add(base, files) {
  const scene = files.length ? await send(files, { base: base.id }) : null;
  if (!scene || scene.id === base.id) return;
  go("scenes", scene.id);
  if (base.status === "failed") await deleteScene(base.id); // it could never be rendered
}

/** The scene that is open, where it says that it lacks each of these files. @param {File[]} files */
function sceneThatLacks(files) {
  const { path } = here();
  const scene = path[0] === "scenes" ? scenes.value?.find(({ id }) => id === path[1]) : undefined;
  const sentences = scene ? [scene.error ?? "", ...scene.warnings].filter((sentence) => LACKS.test(sentence)).join(" ") : "";
  return scene && sentences && files.every(({ name }) => sentences.includes(name)) ? scene : null;
}

/**
 * Of an upload with several scenes, shows another one.
 *
 * @param {Scene} base
 * @param {string} main its file
 */
export async function showOther(base, main) {
  const scene = await send([], { base: base.id, main });
  if (scene) go("scenes", scene.id);
}

/**
 * @param {NamedFile[]} files
 * @param {Record<string, string>} [fields] of the form, beside the files
 * @returns {Promise<Scene | null>} null where it was called off, or refused, which is said then
 */
async function send(files, fields = {}) {
  const title = titleOf(files);
  const total = files.reduce((sum, { file }) => sum + file.size, 0);
  const card = new Card(title);
  const abort = new AbortController();
  const bar = h("div");
  const track = h(
    "div",
    {
      class: "progress",
      role: "progressbar",
      "aria-label": t("Uploading {title}", { title }),
      "aria-valuemin": "0",
      "aria-valuemax": "100",
    },
    bar,
  );
  const line = h("p", { class: "detail number" }, t("Uploading {size}", { size: bytes(total) }));
  card.lead.replaceWith(icon("upload"));
  fill(card.body, track, line);
  fill(card.actions, h("button", { class: "text-button", type: "button", onclick: () => abort.abort() }, t("Cancel")));
  announce(t("Uploading {title}", { title }));
  /** @param {number} fraction */
  const show = (fraction) => {
    bar.style.transform = `scaleX(${fraction})`;
    track.setAttribute("aria-valuenow", String(Math.round(fraction * 100)));
  };
  show(0);
  try {
    const scene = await upload(files, {
      fields,
      signal: abort.signal,
      progress: (sent, all) => {
        show(sent / Math.max(1, all));
        setText(line, sent < all ? t("{done} of {all}", { done: bytes(sent), all: bytes(all) }) : t("Storing …"));
      },
    });
    adoptScene(scene);
    return scene;
  } catch (error) {
    if (!abort.signal.aborted)
      showError(t("{title} was not taken", { title }), error, {
        // The service's own sentences say what to do; a lost connection has none.
        remedy: error instanceof ApiError && error.status === 0 ? t("Drop it again when the service is back.") : undefined,
        action: { label: t("Choose other files"), run: () => choose({ folder: false }) },
      });
    return null;
  } finally {
    card.remove();
  }
}

/** An image alone is no scene; what it may be is said, and one that lights scenes can be kept. @param {File[]} files */
function explainImages(files) {
  const name = files.length > 1 ? t("{name} and {n} more", { name: files[0]?.name ?? "", n: files.length - 1 }) : (files[0]?.name ?? "");
  const isLight = files.length === 1 && hasLight(files);
  const file = /** @type {File} */ (files[0]);
  const keep = () => {
    const abort = new AbortController();
    addEnvironment(file, { progress: () => {}, signal: abort.signal }).then(
      () => announce(t("{name} is now among the lights of every scene", { name })),
      (error) => showError(t("{name} was not taken", { name }), error),
    );
  };
  showError(t("{name} is no scene", { name }), isLight ? t("It can light one: open a scene, and drop it there.") : t("Images are textures of a scene, or light it. Drop them with the scene's file, or drop one image on the page of a scene to light it."), {
    action: isLight ? { label: t("Add it to the lights"), run: keep } : undefined,
  });
}

/**
 * @param {() => NamedFile[] | Promise<NamedFile[]>} gather
 * @param {(files: NamedFile[]) => Promise<void>} [take]
 */
async function startFrom(gather, take = start) {
  try {
    await take(await gather());
  } catch (error) {
    showError(t("The files could not be read"), error);
  }
}

/**
 * Opens the system's file dialog.
 *
 * @param {{folder: boolean}} options
 */
export const choose = ({ folder }) => pick({ folder }, start);

/**
 * @param {{folder: boolean}} options
 * @param {(files: NamedFile[]) => Promise<void>} take
 */
function pick({ folder }, take) {
  const input = h("input", { type: "file", multiple: true, webkitdirectory: folder, hidden: true });
  input.addEventListener("change", () => void startFrom(() => filesOfList(input.files ?? new DataTransfer().files), take));
  input.addEventListener("cancel", () => input.remove());
  input.addEventListener("change", () => input.remove());
  document.body.append(input);
  input.click();
}

/** Lets files be dropped anywhere on the page. */
export function acceptDrops() {
  const veil = /** @type {HTMLElement} */ (document.getElementById("drop-veil"));
  fill(
    veil,
    icon("upload"),
    h("strong", null, t("Drop to upload")),
    h("span", { class: "quiet" }, t("A scene: its file, its folder or a zip; or an HDRI, to light the scene that is open")),
  );
  let depth = 0; // enter and leave fire for every element that is crossed
  /** @param {DragEvent} event */
  const hasFiles = (event) => event.dataTransfer?.types.includes("Files") ?? false;
  const isFree = mayChange(chosenProject());
  /** @param {number} next */
  const setDepth = (next) => {
    depth = Math.max(0, next);
    veil.hidden = depth === 0 || !isFree;
  };
  addEventListener("dragenter", (event) => hasFiles(event) && setDepth(depth + 1));
  addEventListener("dragleave", (event) => hasFiles(event) && setDepth(depth - 1));
  addEventListener("dragover", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault(); // else the browser leaves the page for the file
    if (!isFree && event.dataTransfer) event.dataTransfer.dropEffect = "none";
  });
  addEventListener("drop", (event) => {
    if (!hasFiles(event) || !event.dataTransfer) return;
    event.preventDefault();
    setDepth(0);
    if (!isFree) return;
    const gathering = filesOfDrop(event.dataTransfer);
    void startFrom(() => gathering);
  });
}
