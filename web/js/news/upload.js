/** An upload. Uses XMLHttpRequest, because fetch reports no upload progress. */

import { ApiError, UPLOAD_URL, errorOf } from "./api.js";
import { inProject } from "../base/project.js";
import { t } from "../base/words.js";

/** @typedef {import("../shell/gather-files.js").NamedFile} NamedFile */
/** @typedef {import("../base/types.js").Scene} Scene */

/** Options for uploads: a scene without lights gets the studio light and a floor. */
const STAND = { floor: "auto" };

/**
 * @param {NamedFile[]} files
 * @param {{progress: (sent: number, total: number) => void, signal: AbortSignal, fields?: Record<string, string>}} options
 *     fields: further form fields
 * @returns {Promise<Scene>} Rejects with ApiError, or with the signal's reason when it is aborted.
 */
export const upload = (files, options) => sendFiles(inProject(UPLOAD_URL), "files", files, { ...options, fields: { ...STAND, ...options.fields } });

/**
 * @param {string} url
 * @param {string} field name of the form field with the files
 * @param {NamedFile[]} files
 * @param {{progress: (sent: number, total: number) => void, signal: AbortSignal, fields?: Record<string, string>}} options
 * @returns {Promise<any>} what the service answers. Rejects as `upload`.
 */
export function sendFiles(url, field, files, { progress, signal, fields = {} }) {
  const form = new FormData();
  for (const [name, value] of Object.entries(fields)) form.append(name, value);
  for (const { file, path } of files) form.append(field, file, path);
  return new Promise((resolve, reject) => {
    const request = new XMLHttpRequest();
    request.open("POST", url);
    request.upload.onprogress = ({ loaded, total }) => progress(loaded, total);
    request.onload = () => {
      if (request.status >= 200 && request.status < 300) resolve(JSON.parse(request.responseText));
      else reject(errorOf(request.status, request.responseText));
    };
    // A service that refuses a large body early may close the connection before its response is read.
    request.onerror = () =>
      reject(new ApiError(0, t("The upload was interrupted: the service does not respond, or refused its size.")));
    request.onabort = () => reject(signal.reason);
    signal.addEventListener("abort", () => request.abort());
    if (signal.aborted) reject(signal.reason);
    else request.send(form);
  });
}
