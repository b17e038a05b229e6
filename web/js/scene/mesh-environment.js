/** The light around a preview mesh: blurred more from level to level for rough reflections, and as irradiance for diffuse surfaces. */

import { decode } from "../film/rgb9e5.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** Equirectangular radiance, three values a texel, rows from the top. @typedef {{width: number, height: number, texels: Float32Array}} Environment */

/** Rows of the first level, which is not blurred, and the number of levels; the last one is of roughness 1. */
export const HEIGHT = 64;
export const LEVELS = 5;
/** Weight of a lobe's kernel below which a texel is left out. */
const NEGLIGIBLE = 0.002;
const COEFFICIENTS = 9; // of spherical harmonics

/** The studio's lamps (renderer/scene/studio.py): towards the light, its radiance, and the cosine lobe's exponent. */
const LAMPS = /** @type {[Vec3, number, number][]} */ ([
  [[-0.65, 0.75, 0.6], 4.2, 12],
  [[0.8, 0.4, -0.75], 3, 24],
]);
const [GROUND, HORIZON, ZENITH] = [0.2, 0.5, 0.65];

/** Returns how far a direction goes along an axis. @param {Float64Array} ways of directionsOf @param {number} i @param {Vec3} axis */
const alongOf = (ways, i, axis) => (ways[4 * i] ?? 0) * axis[0] + (ways[4 * i + 1] ?? 0) * axis[1] + (ways[4 * i + 2] ?? 0) * axis[2];

/** @type {Map<number, Float64Array>} */
const known = new Map();

/** Returns the direction of each texel's middle, and the sine of its polar angle. @param {number} height of a table twice as wide */
function directionsOf(height) {
  const found = known.get(height) ?? new Float64Array(8 * height * height);
  if (known.has(height)) return found;
  known.set(height, found);
  for (let row = 0, i = 0; row < height; row++) {
    const theta = ((row + 0.5) * Math.PI) / height;
    const [sine, cosine] = [Math.sin(theta), Math.cos(theta)];
    for (let column = 0; column < 2 * height; column++) {
      const phi = ((column + 0.5) * Math.PI) / height - Math.PI;
      found[i++] = sine * Math.sin(phi);
      found[i++] = cosine;
      found[i++] = -sine * Math.cos(phi);
      found[i++] = sine;
    }
  }
  return found;
}

/** Unpacks a packet's environment. @param {import("../news/mesh-packet.js").Environment} packed @returns {Environment} */
export const unpacked = ({ width, height, words }) => ({ width, height, texels: Float32Array.from([...words].flatMap((word) => decode(word))) });

/** Returns the radiance of the light that scenes without lights are given, as renderer/scene/studio.py does. @returns {Environment} */
export function studio() {
  const texels = new Float32Array(6 * HEIGHT * HEIGHT);
  const lamps = LAMPS.map(([at, radiance, exponent]) => ({ at: /** @type {Vec3} */ (at.map((value) => value / Math.hypot(...at))), radiance, exponent }));
  const ways = directionsOf(HEIGHT);
  for (let i = 0; i < 2 * HEIGHT * HEIGHT; i++) {
    const [x, y, z] = [ways[4 * i] ?? 0, ways[4 * i + 1] ?? 0, ways[4 * i + 2] ?? 0];
    let value = y > 0 ? HORIZON + (ZENITH - HORIZON) * y : GROUND + (HORIZON - GROUND) * Math.exp(4 * y);
    for (const { at, radiance, exponent } of lamps) value += radiance * Math.max(x * at[0] + y * at[1] + z * at[2], 0) ** exponent;
    texels[3 * i] = texels[3 * i + 1] = texels[3 * i + 2] = value;
  }
  return { width: 2 * HEIGHT, height: HEIGHT, texels };
}

/**
 * What the shader reads.
 *
 * @typedef {object} LightTables
 * @property {{width: number, height: number, texels: Float32Array}[]} levels RGBA, each half as large as the one before
 * @property {{radiance: Vec3, albedo: number, beyond: Vec3, below: {radiance: Vec3, around: LightTables["levels"][number]}} | null} floor radiance: where no shadow falls on it. below: of its lower side, and the light around that. beyond: radiance just below the horizon, between the floor's far end and that, in proportion to the radiance just above; null: there is none
 * @property {Float32Array} irradiance divided by pi, as nine coefficients of spherical harmonics, three values each
 */

/**
 * What is around a scene besides its environment. up: in the scene. hasFloor: whether it stands on a floor, which hides what is below.
 * suns: radiance of a white floor in the light of lamps that are far away. around: mean radiance that other surfaces and weak lamps add. isAlone: whether nothing else lights the scene; then most of it comes from
 * below, where there mostly is a ground, and little from above, where there is nothing.
 *
 * @typedef {{up: Vec3, hasFloor: boolean, suns?: Vec3, around: Vec3, isAlone: boolean}} Surroundings
 */

/** How much more comes from below, and less from above, of the light that surfaces reflect in a black world. */
const GROUNDED = 0.9;

/** @param {Environment | null} environment null: black @param {Surroundings} surroundings @returns {LightTables} */
export function lightTables(environment, { up, hasFloor, suns = [0, 0, 0], around, isAlone }) {
  const whole = new Float32Array(6 * HEIGHT * HEIGHT);
  const { width, height, texels } = environment ?? { width: 1, height: 1, texels: new Float32Array(3) };
  const ways = directionsOf(HEIGHT);
  for (let row = 0; row < HEIGHT; row++)
    for (let column = 0; column < 2 * HEIGHT; column++) {
      const at = width * Math.floor((row * height) / HEIGHT) + Math.floor((column * width) / (2 * HEIGHT));
      const texel = 2 * HEIGHT * row + column;
      const share = isAlone ? 1 - GROUNDED * alongOf(ways, texel, up) : 1;
      for (let k = 0; k < 3; k++) whole[3 * texel + k] = (texels[3 * at + k] ?? 0) + share * (around[k] ?? 0);
    }
  const floor = hasFloor ? layFloor(whole, up, suns) : null;
  let source = halved(whole, HEIGHT);
  const levels = [whole, source]; // a texel of the second is as wide as its lobe
  for (let level = 2; level <= LEVELS; level++) {
    const height = HEIGHT >> level;
    levels.push(blurred(source, 2 * height, height, level / LEVELS));
    source = halved(source, 2 * height);
  }
  return { levels: levels.map((texels, i) => ({ width: 2 * (HEIGHT >> i), height: HEIGHT >> i, texels: withAlpha(texels) })), floor, irradiance: harmonicsOf(halved(halved(whole, HEIGHT), HEIGHT / 2), HEIGHT / 4) };
}

/** Irradiance of a horizontal surface in the studio, divided by pi. @type {number | undefined} */
let usual;

/** Replaces what is below the horizon by the studio's floor, whose albedo makes it as bright as the horizon in the studio. @param {Float32Array} texels @param {Vec3} above @param {Vec3} suns @returns {LightTables["floor"]} without the suns, which the floor's shader adds */
function layFloor(texels, above, suns) {
  const irradiance = upwardIrradiance(texels, above);
  const fromBelow = upwardIrradiance(texels, /** @type {Vec3} */ (above.map((value) => -value)));
  const around = { width: 2 * HEIGHT, height: HEIGHT, texels: withAlpha(texels) };
  usual ??= upwardIrradiance(studio().texels, [0, 1, 0])[0] ?? 1;
  const albedo = HORIZON / usual;
  const radiance = /** @type {Vec3} */ (irradiance.map((value) => value * albedo));
  const sunny = radiance.map((value, i) => value + albedo * (suns[i] ?? 0));
  const ways = directionsOf(HEIGHT);
  const [over, under] = [[0, 0, 0], [0, 0, 0]]; // sums of what is around the horizon
  for (let i = 0; i < 2 * HEIGHT * HEIGHT; i++) {
    const along = alongOf(ways, i, above);
    const rows = (along * HEIGHT) / Math.PI; // above the horizon
    if (Math.abs(rows) < 2) {
      const sum = along < 0 ? under : over;
      const weight = Math.abs(rows) < 1 ? 1.5 : -0.5; // what two rows have, continued to the horizon
      for (let k = 0; k < 3; k++) sum[k] = (sum[k] ?? 0) + weight * (texels[3 * i + k] ?? 0);
    }
    if (along < 0) texels.set(sunny, 3 * i);
  }
  const beyond = /** @type {Vec3} */ (under.map((value, k) => (over[k] ?? 0) > 0 ? Math.max(value / (over[k] ?? 1), 0) : 1));
  return { radiance, albedo, beyond, below: { radiance: /** @type {Vec3} */ (fromBelow.map((value) => value * albedo)), around } };
}

/** Returns the irradiance of a horizontal surface divided by pi. @param {Float32Array} texels @param {Vec3} above */
function upwardIrradiance(texels, above) {
  const sum = [0, 0, 0];
  let total = 0;
  const ways = directionsOf(HEIGHT);
  for (let i = 0; i < 2 * HEIGHT * HEIGHT; i++) {
    const weight = Math.max(alongOf(ways, i, above), 0) * (ways[4 * i + 3] ?? 0);
    total += weight;
    for (let k = 0; k < 3; k++) sum[k] = (sum[k] ?? 0) + weight * (texels[3 * i + k] ?? 0);
  }
  return sum.map((value) => value / total);
}

/** Returns a table of half the size. @param {Float32Array} texels three values each @param {number} width of the result */
function halved(texels, width) {
  const found = new Float32Array((3 * width * width) / 2);
  for (let row = 0; row < width / 2; row++)
    for (let column = 0; column < width; column++)
      for (let k = 0; k < 3; k++) {
        const at = 3 * (4 * width * row + 2 * column) + k;
        const below = at + 6 * width;
        found[3 * (width * row + column) + k] = ((texels[at] ?? 0) + (texels[at + 3] ?? 0) + (texels[below] ?? 0) + (texels[below + 3] ?? 0)) / 4;
      }
  return found;
}

/**
 * Returns radiance as a rough surface reflects it that is seen from its normal's direction. Source: Karis 2013, "Real shading in
 * Unreal Engine 4", the split sum.
 *
 * @param {Float32Array} source a table of twice the size
 * @param {number} width of the result
 * @param {number} height
 * @param {number} roughness
 */
function blurred(source, width, height, roughness) {
  const alpha2 = roughness ** 4;
  /** Returns the lobe's weight for the cosine of the angle between the light and the mirror direction. @param {number} cosine */
  const kernel = (cosine) => {
    const d = 1 - (0.5 * (1 + cosine)) * (1 - alpha2); // the half vector's squared cosine is (1 + cosine) / 2
    return cosine > 0 ? cosine * (alpha2 / d) ** 2 : 0;
  };
  let least = 0;
  while (least < 1 && kernel(least) < NEGLIGIBLE * kernel(1)) least += 0.002;
  const count = 4 * width * height;
  const [ways, mirrors] = [directionsOf(2 * height), directionsOf(height)];
  const found = new Float32Array(3 * width * height);
  for (let i = 0; i < width * height; i++) {
    const [x, y, z] = [mirrors[4 * i] ?? 0, mirrors[4 * i + 1] ?? 0, mirrors[4 * i + 2] ?? 0];
    let [red, green, blue, total] = [0, 0, 0, 1e-9];
    for (let k = 0; k < count; k++) {
      const cosine = x * (ways[4 * k] ?? 0) + y * (ways[4 * k + 1] ?? 0) + z * (ways[4 * k + 2] ?? 0);
      if (cosine < least) continue;
      const weight = kernel(cosine) * (ways[4 * k + 3] ?? 0);
      total += weight;
      red += weight * (source[3 * k] ?? 0);
      green += weight * (source[3 * k + 1] ?? 0);
      blue += weight * (source[3 * k + 2] ?? 0);
    }
    found.set([red / total, green / total, blue / total], 3 * i);
  }
  return found;
}

/** @param {Float32Array} texels three values each */
function withAlpha(texels) {
  const found = new Float32Array((4 * texels.length) / 3);
  for (let i = 0; i < texels.length / 3; i++) {
    for (let k = 0; k < 3; k++) found[4 * i + k] = texels[3 * i + k] ?? 0;
    found[4 * i + 3] = 1;
  }
  return found;
}

/** Returns the first nine spherical harmonics at a direction. @param {Vec3} way */
const harmonics = ([x, y, z]) => [0.282095, 0.488603 * y, 0.488603 * z, 0.488603 * x, 1.092548 * x * y, 1.092548 * y * z, 0.315392 * (3 * z * z - 1), 1.092548 * x * z, 0.546274 * (x * x - y * y)];
/** Coefficients of the cosine lobe, divided by pi, for each band. */
const LOBE = [1, 2 / 3, 2 / 3, 2 / 3, 1 / 4, 1 / 4, 1 / 4, 1 / 4, 1 / 4];

/** Returns irradiance divided by pi of a surface with a normal. @param {Float32Array} irradiance of LightTables @param {Vec3} normal @returns {Vec3} */
export const irradianceAt = (irradiance, normal) => {
  const sum = /** @type {Vec3} */ ([0, 0, 0]);
  harmonics(normal).forEach((value, i) => sum.forEach((_, k) => (sum[k] = (sum[k] ?? 0) + value * (irradiance[3 * i + k] ?? 0))));
  return /** @type {Vec3} */ (sum.map((value) => Math.max(value, 0)));
};

/** Returns irradiance by spherical harmonics. Source: Ramamoorthi and Hanrahan 2001. @param {Float32Array} texels @param {number} height */
function harmonicsOf(texels, height) {
  const found = new Float32Array(3 * COEFFICIENTS);
  const ways = directionsOf(height);
  for (let at = 0; at < 2 * height * height; at++) {
    const area = (Math.PI / height) ** 2 * (ways[4 * at + 3] ?? 0);
    harmonics([ways[4 * at] ?? 0, ways[4 * at + 1] ?? 0, ways[4 * at + 2] ?? 0]).forEach((value, i) => {
      for (let k = 0; k < 3; k++) found[3 * i + k] = (found[3 * i + k] ?? 0) + area * value * (LOBE[i] ?? 0) * (texels[3 * at + k] ?? 0);
    });
  }
  return found;
}
