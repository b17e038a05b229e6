/** What the form of a picture's settings shows first: the settings of an earlier job, or of a take. */

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").Shot} Shot */
/** @typedef {import("../base/types.js").Take} Take */
/** @typedef {import("../base/types.js").View} View */

/** @typedef {Pick<Shot, "frames" | "count" | "fps" | "clip" | "turntable"> & Partial<Shot>} ShotStart */
/**
 * @typedef {object} FormStart
 * @property {Record<string, any>} first settings by name; `light`: the environment of a request
 * @property {ShotStart | null} shot
 * @property {string | null} [variant] null: the scene's own
 * @property {string | null} [up] likewise
 * @property {string | null} [floor] likewise
 * @property {boolean} denoise
 * @property {string[]} [needs]
 * @property {View | null} view a custom view; null: a camera of the scene
 * @property {string | number} [camera] by name or number; the first if left out
 */

/** @param {Job} job @returns {FormStart} */
export function startOfJob({ settings, spp, noise, seconds, environment, shot = null, variant, up, floor, denoise, needs }) {
  // Not for a shot, whose camera may be animated, while a custom view is static.
  const view = settings && !shot ? settings["view"] : null;
  return { first: { ...settings, spp, noise, seconds, light: environment }, shot, variant, up, floor, denoise: Boolean(denoise), needs: needs ?? [], view };
}

/**
 * @param {Pick<Take, "request">} take
 * @param {Record<string, any>} now the form's current request, whose goals stay
 * @returns {FormStart}
 */
export function startOfTake({ request }, now) {
  const { environment = null, camera, view = null, variant, up, floor, frame, clip, fps, turntable, scene: _, ...settings } = request;
  const { noise = null, seconds = null } = now;
  const numbers = Object.entries(environment ?? {}).map(([name, value]) => [`environment_${name}`, value]);
  const still = { frames: String(frame ?? 0), count: 1, fps: fps ?? null, clip: clip ?? null, turntable: turntable ?? null };
  return {
    first: { ...settings, ...Object.fromEntries(numbers), noise, seconds, light: environment, environment: environment?.color ?? null },
    shot: still,
    ...{ variant, up, floor, denoise: Boolean(now["denoise"]), view, camera },
  };
}
