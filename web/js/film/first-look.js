/** Hands the live view's last picture to the page of the job that was started from it, which shows it until it has samples. */

/** @typedef {import("./film.js").Film} Film */

/** @type {{job: string, film: Film} | null} */
let kept = null;

/** @param {string} job @param {Film} film */
export function keepFirstLook(job, film) {
  kept = film.isBlank ? null : { job, film };
}

/** Returns and removes the picture that was kept for a job. @param {string} job @returns {Film | null} */
export function takeFirstLook(job) {
  const film = kept?.job === job ? kept.film : null;
  if (film) kept = null;
  return film;
}
