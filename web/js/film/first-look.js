/** Hands the live view's last picture, or an earlier job's, to the page of the job that was started from it, which shows it until it has samples. */

/** @typedef {import("./film.js").Film} Film */

/**
 * isPrevious: whether it is a whole picture of the same view, shown until the job's own is as good. isSame: whether it is of the job's view; else the camera has turned since. clean: URL of what was shown in place of the film until
 * it is denoised; "": the film was shown. worth: samples per pixel of a denoised picture that looks as good; 0 if the camera or the scene has changed since. place: where the whole picture was, in CSS pixels of the window.
 *
 * @typedef {{film: Film, isSame: boolean, clean: string, worth?: number, isPrevious?: boolean, place?: DOMRect}} FirstLook
 */

/** @type {(FirstLook & {job: string}) | null} */
let kept = null;

/** @param {string} job @param {FirstLook} look */
export function keepFirstLook(job, look) {
  kept = look.film.isBlank && !look.clean ? null : { job, ...look };
}

/** Loads and decodes a look's `clean`, which the next page then shows at once. @param {FirstLook} look @returns {Promise<unknown>} */
export async function prepareLook({ clean }) {
  if (!clean) return;
  const image = new Image();
  image.src = clean;
  await image.decode().catch(() => {}); // the page shows the film instead
  loaded = image;
}

/** Keeps the latest prepared picture decoded. @type {HTMLImageElement | null} */
let loaded = null;

/** Returns the decoded picture of a URL; null if it is another one. @param {string} url @returns {HTMLImageElement | null} */
export function takePrepared(url) {
  const found = url && loaded?.src === url ? loaded : null;
  loaded = null;
  return found;
}

/** Returns and removes the picture that was kept for a job. @param {string} job @returns {FirstLook | null} */
export function takeFirstLook(job) {
  const found = kept?.job === job ? kept : null;
  if (found) kept = null;
  return found;
}
