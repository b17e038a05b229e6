/** Directions from which the light around a preview mesh comes, chosen in proportion to it: from each, a shadow map is drawn. */

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** A direction towards the light. color: what it adds to the radiance of a white surface that faces it: radiance times weight. @typedef {{way: Vec3, color: Vec3, weight: number}} LightSample */

/** Steps of Roberts' sequence, whose points fill a square evenly at any number of them. Source: Roberts 2018, "The unreasonable effectiveness of quasirandom sequences". */
const STEPS = /** @type {const} */ ([0.7548776662466927, 0.5698402909980532]);

/** @param {number} red @param {number} green @param {number} blue */
export const luminance = (red, green, blue) => 0.2126 * red + 0.7152 * green + 0.0722 * blue;

/**
 * Returns directions whose colours, times the cosine of the angle to a normal, add up to irradiance divided by pi. The sum over the first k
 * of n directions, times n / k, is an estimate too.
 *
 * @param {{width: number, height: number, texels: Float32Array}} table equirectangular radiance, four values each
 * @param {number} count
 * @returns {LightSample[]} none if there is no light
 */
export function lightSamples({ width, height, texels }, count) {
  const rows = new Float64Array(height + 1);
  const columns = new Float64Array(height * (width + 1));
  for (let row = 0; row < height; row++) {
    const sine = Math.sin(((row + 0.5) * Math.PI) / height);
    const first = row * (width + 1);
    for (let column = 0; column < width; column++) {
      const at = 4 * (row * width + column);
      columns[first + column + 1] = (columns[first + column] ?? 0) + sine * luminance(texels[at] ?? 0, texels[at + 1] ?? 0, texels[at + 2] ?? 0);
    }
    rows[row + 1] = (rows[row] ?? 0) + (columns[first + width] ?? 0);
  }
  const total = rows[height] ?? 0;
  if (!(total > 0)) return [];
  // Of all light, the part of one sample: a texel's area is 2 pi^2 / (width * height) times the sine.
  const share = (total * 2 * Math.PI) / (width * height * count);
  return Array.from({ length: count }, (_, i) => {
    const [row, down] = found(rows, 0, height, (0.5 + (i + 1) * STEPS[0]) % 1);
    const [column, across] = found(columns, row * (width + 1), width, (0.5 + (i + 1) * STEPS[1]) % 1);
    const at = 4 * (row * width + column);
    const [red, green, blue] = [texels[at] ?? 0, texels[at + 1] ?? 0, texels[at + 2] ?? 0];
    const theta = ((row + down) * Math.PI) / height;
    const phi = ((column + across) * 2 * Math.PI) / width - Math.PI;
    const weight = share / luminance(red, green, blue);
    return {
      way: /** @type {Vec3} */ ([Math.sin(theta) * Math.sin(phi), Math.cos(theta), -Math.sin(theta) * Math.cos(phi)]),
      color: /** @type {Vec3} */ ([red * weight, green * weight, blue * weight]),
      weight,
    };
  });
}

/**
 * Returns the interval of a cumulative sum that a share of it falls into, and where in the interval.
 *
 * @param {Float64Array} sums
 * @param {number} first index of the sum's first value, which is 0
 * @param {number} length number of intervals
 * @param {number} share from 0 to 1, without 1
 * @returns {[number, number]}
 */
function found(sums, first, length, share) {
  const wanted = share * (sums[first + length] ?? 0);
  let [low, high] = [0, length];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if ((sums[first + middle] ?? 0) <= wanted) low = middle;
    else high = middle;
  }
  const [start, end] = [sums[first + low] ?? 0, sums[first + low + 1] ?? 0];
  return [low, end > start ? Math.min((wanted - start) / (end - start), 1) : 0.5];
}
