/** Arithmetic of the light tool: angles, strengths and directions. */

/** @typedef {import("../base/types.js").Vec3} Vec3 */

/** Doublings of the strength over the view's height; its width is one full rotation. */
const STOPS_A_HEIGHT = 4;
/** Dead zone in pixels, since a sideways drag also moves slightly up or down. */
const SLACK = { across: 3, up: 16 };
const LEAST_STRENGTH = 0.01;
const MOST_STRENGTH = 1000;
/** Minimum elevation in degrees, used if the sun would be below the horizon. */
const LOWEST_SUN = 2;

/** @param {number} degrees @returns {number} -180 ... 180, as the slider has it */
export const halfTurn = (degrees) => {
  const around = ((degrees % 360) + 360) % 360;
  return around > 180 ? around - 360 : around;
};

/** @param {number} strength @param {number} stops */
export const brighter = (strength, stops) =>
  Number(Math.min(Math.max(Math.max(strength, LEAST_STRENGTH) * 2 ** stops, LEAST_STRENGTH), MOST_STRENGTH).toPrecision(3));

/** @param {number} pixels @param {number} slack */
const past = (pixels, slack) => Math.sign(pixels) * Math.max(0, Math.abs(pixels) - slack);

/**
 * The light after a drag: the background follows the pointer sideways; up is brighter.
 *
 * @param {{rotation: number, strength: number}} before the drag
 * @param {{across: number, up: number}} moved pixels, to the right and up
 * @param {{width: number, height: number}} size of the view on the screen
 * @returns {{rotation: number, strength: number}}
 */
export function dragged(before, moved, { width, height }) {
  const turn = (360 * past(moved.across, SLACK.across)) / width;
  const stops = (STOPS_A_HEIGHT * past(moved.up, SLACK.up)) / height;
  return {
    rotation: turn ? halfTurn(Math.round(before.rotation - turn)) : before.rotation,
    strength: stops ? brighter(before.strength, stops) : before.strength,
  };
}

/**
 * The sun's position for a click: in the sky, at the click; on a surface, the mirror direction, so that its highlight is at the
 * click.
 *
 * @param {{direction: Vec3, normal: Vec3 | null}} picked which way the eye looks, a unit vector; null: nothing is there
 * @returns {{elevation: number, azimuth: number, isRaised: boolean}} degrees; azimuth clockwise from -Z, seen from above; raised: it
 *     would have to stand below the horizon
 */
export function sunFor({ direction, normal }) {
  const [x, y, z] = normal ? reflected(direction, normal) : direction;
  const elevation = (Math.asin(Math.min(Math.max(y, -1), 1)) * 180) / Math.PI;
  const azimuth = (Math.atan2(x, -z) * 180) / Math.PI;
  return { elevation: Math.max(elevation, LOWEST_SUN), azimuth: (azimuth + 360) % 360, isRaised: elevation < LOWEST_SUN };
}

/** @param {Vec3} d unit @param {Vec3} n of any side, and length @returns {Vec3} unit */
function reflected(d, n) {
  const size = Math.hypot(...n);
  if (!(size > 0)) return [-d[0], -d[1], -d[2]]; // no normal: light from the viewer
  const twice = (2 * (d[0] * n[0] + d[1] * n[1] + d[2] * n[2])) / (size * size);
  return [d[0] - twice * n[0], d[1] - twice * n[1], d[2] - twice * n[2]];
}
