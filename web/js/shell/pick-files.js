/** Passes on files from a drop or a file dialog. */

import { h } from "../base/dom.js";
import { filesOfList, notUploadedTitle } from "./gather-files.js";
import { clearUploadNotices, showError } from "./tray.js";
import { t } from "../base/words.js";

/** @typedef {import("./gather-files.js").NamedFile} NamedFile */

/**
 * @param {() => NamedFile[] | Promise<NamedFile[]>} gather
 * @param {(files: NamedFile[]) => Promise<void>} take
 */
export async function gatherAndSend(gather, take) {
  clearUploadNotices();
  let files;
  try {
    files = await gather();
  } catch (error) {
    showError(t("The files could not be read"), error, { ofUpload: true });
    return;
  }
  await attempt(files, take);
}

/** @param {NamedFile[]} files @param {(files: NamedFile[]) => Promise<void>} take */
async function attempt(files, take) {
  try {
    await take(files);
  } catch (error) {
    showError(notUploadedTitle(files), error, { ofUpload: true, action: { label: t("Try again"), run: () => void attempt(files, take) } });
  }
}

/**
 * Opens the system's file dialog.
 *
 * @param {{folder: boolean}} options
 * @param {(files: NamedFile[]) => Promise<void>} take
 */
export function pick({ folder }, take) {
  const input = h("input", { type: "file", multiple: true, webkitdirectory: folder, hidden: true });
  input.addEventListener("change", () => void gatherAndSend(() => filesOfList(input.files ?? new DataTransfer().files), take));
  input.addEventListener("cancel", () => input.remove());
  input.addEventListener("change", () => input.remove());
  document.body.append(input);
  input.click();
}
