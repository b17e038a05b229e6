/** Dropping and selecting files. */

import { fill, h } from "../base/dom.js";
import { chosenProject } from "../base/project.js";
import { filesOfDrop } from "./gather-files.js";
import { icon } from "../base/icons.js";
import { mayChange } from "../news/projects.js";
import { pick, gatherAndSend } from "./pick-files.js";
import { t } from "../base/words.js";

/** @typedef {import("./gather-files.js").NamedFile} NamedFile */

/** Uploads files, with modules that are loaded after the page (./ahead.js). @param {NamedFile[]} files */
async function upload(files) {
  const { start } = await import("./uploads.js").catch(() => {
    throw new Error(t("This part of the page could not be loaded"));
  });
  await start(files);
}

/** Event of the window when files are chosen or dragged. */
export const UPLOAD_LIKELY = "upload-likely";

/** Prepares for an upload while files are chosen or dragged. */
function prepare() {
  dispatchEvent(new Event(UPLOAD_LIKELY));
  void import("./uploads.js").then((uploads) => uploads.prepare(), () => {}); // an upload reports the error
}

/**
 * Opens the system's file dialog.
 *
 * @param {{folder: boolean}} options
 */
export function choose({ folder }) {
  prepare();
  pick({ folder }, upload);
}

/** Time without an event after which nothing is dragged any more. */
const DRAG_ENDED_MS = 1000;

/** Accepts files dropped anywhere on the page. */
export function acceptDrops() {
  const veil = /** @type {HTMLElement} */ (document.getElementById("drop-veil"));
  fill(
    veil,
    icon("upload"),
    h("strong", null, t("Drop to upload")),
    h("span", { class: "quiet" }, t("A scene: its file, its folder or a zip; or an HDRI, to light the scene that is open")),
  );
  const isFree = mayChange(chosenProject());
  /** @param {DragEvent} event */
  const hasFiles = (event) => event.dataTransfer?.types.includes("Files") ?? false;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let ending;
  const hide = () => {
    clearTimeout(ending);
    veil.hidden = true;
  };
  addEventListener("dragover", (event) => {
    if (!hasFiles(event)) return;
    event.preventDefault(); // otherwise the browser opens the file
    if (!isFree && event.dataTransfer) event.dataTransfer.dropEffect = "none";
    if (veil.hidden && isFree) prepare();
    veil.hidden = !isFree;
    // It comes several times a second as long as something is dragged; a dragleave may be lost.
    clearTimeout(ending);
    ending = setTimeout(hide, DRAG_ENDED_MS);
  });
  addEventListener("dragleave", (event) => event.relatedTarget === null && hide());
  addEventListener("drop", (event) => {
    if (!hasFiles(event) || !event.dataTransfer) return;
    event.preventDefault();
    hide();
    if (!isFree) return;
    const gathering = filesOfDrop(event.dataTransfer);
    void gatherAndSend(() => gathering, upload);
  });
}
