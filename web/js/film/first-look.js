/** Hands the live view's last picture to the page of the job that was started from it, which shows it until it has samples. */

/** @typedef {import("./film.js").Film} Film */

/** @typedef {{film: Film, isSame: boolean}} FirstLook isSame: whether it is of the job's view; else the camera has turned since */

/** @type {(FirstLook & {job: string}) | null} */
let kept = null;

/** @param {string} job @param {Film} film @param {boolean} isSame as FirstLook has it */
export function keepFirstLook(job, film, isSame) {
  kept = film.isBlank ? null : { job, film, isSame };
}

/** Returns and removes the picture that was kept for a job. @param {string} job @returns {FirstLook | null} */
export function takeFirstLook(job) {
  const found = kept?.job === job ? kept : null;
  if (found) kept = null;
  return found;
}
