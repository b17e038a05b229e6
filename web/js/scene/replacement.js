/** Decides when a picture of a live view is clear enough to replace what the view shows in its place. */

/**
 * What is shown in place of a view's picture. nothing: the mesh is awaited. thumbnail: a small picture of the view. clear: its poster, or
 * another finished picture of it. mesh: the preview mesh. projected: an earlier picture, projected onto the mesh for the present camera.
 *
 * @typedef {"nothing" | "thumbnail" | "clear" | "mesh" | "projected"} Shown
 */

/**
 * @typedef {object} Facts
 * @property {Shown} shown
 * @property {boolean} isOutdated whether that has another light, or shows the scene otherwise, than the view
 * @property {boolean} isPoor whether a projected picture shows little of the view
 * @property {number} spp samples per pixel of the new picture; 0: a small one
 * @property {number} share of the view's width that it has
 * @property {boolean} isDenoised
 * @property {boolean} isLast whether it has all samples
 * @property {boolean} isLatest whether it is of the latest request
 * @property {boolean} denoises whether denoised pictures of the view come
 * @property {number} waited since the view has a sample per pixel, in milliseconds
 */

/** Samples per pixel after which a view is clear enough to be kept, and one that is never denoised replaces a mesh or a thumbnail: fewer are noise. */
export const SHARP_SPP = 4;
/** Samples per pixel from which a denoised picture replaces the preview mesh: its error is already smaller (docs/performance.md). */
export const FIRST_SPP = 2;
/** Samples per pixel from which a denoised picture replaces a clear one, as many as an idle farm gives a poster. */
export const POSTER_SPP = 16;
/** Time, in milliseconds, after which noise replaces an outdated picture: that it is outdated is worse. */
const OUTDATED_MS = 2000;
/** Part of the view's width from which a picture is as fine as what is shown. */
const FINE_SHARE = 0.75;

/** Distance of the cameras, of 1 (about 50 degrees), up to which a projected picture has neither halos around the shapes nor stretched surfaces. */
const NEAR = 0.05;
/** Part of the view's width that it must have to be as sharp as the mesh. */
const SHARP_SHARE = 0.9;

/** Samples per pixel with which the noise of a view that is never denoised replaces what is shown. @type {Record<Shown, number>} */
const NOISY_SPP = { nothing: SHARP_SPP, thumbnail: SHARP_SPP, mesh: SHARP_SPP, clear: 2 * SHARP_SPP, projected: 1 };

/** Those with which a denoised picture does. @type {Record<Shown, number>} */
const DENOISED_SPP = { nothing: 0, thumbnail: 0, mesh: FIRST_SPP, clear: POSTER_SPP, projected: FIRST_SPP };

/** Returns the samples per pixel with which the view's whole picture replaces what is shown. @param {Shown} shown @param {boolean} denoises */
export const neededSpp = (shown, denoises) => Math.max((denoises ? DENOISED_SPP : NOISY_SPP)[shown], FIRST_SPP);

/** Returns whether a picture replaces what is shown. While denoised pictures come, noise replaces nothing that is of the same view. @param {Facts} facts */
export function replaces({ shown, isOutdated, isPoor, spp, share, isDenoised, isLast, isLatest, denoises, waited }) {
  if (!isLatest) return false;
  if (isOutdated) return isDenoised || !denoises || waited > OUTDATED_MS;
  if (!isDenoised) return !denoises || shown === "nothing" ? isLast || spp >= NOISY_SPP[shown] : false;
  if (isPoor) return true;
  return share >= FINE_SHARE && (isLast || spp >= DENOISED_SPP[shown]);
}

/** Returns whether a picture that is projected for another camera at rest is as sharp as the preview mesh. @param {number} distance of the cameras, 0 ... 1 @param {number} share of the view's width that the picture has */
export const staysSharp = (distance, share) => distance === 0 || (distance <= NEAR && share >= SHARP_SHARE);
