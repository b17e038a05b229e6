/**
 * FLIP: perceived difference of two alternating pictures, 0 to 1 per pixel (Andersson, Nilsson, Akenine-Möller, Oskarsson,
 * Åström, Fairchild 2020, "FLIP: A Difference Evaluator for Alternating Images"). Pictures are sRGB-coded, as displayed.
 */

/** The paper's viewing conditions: a screen of 3840 pixels across 0.7 m, seen from 0.7 m. */
const PIXELS_PER_DEGREE = 67.02;

const QC = 0.7;
const PC = 0.4;
const PT = 0.95;
const QF = 0.5;
const FEATURE_WIDTH = 0.082; // degrees
/** Contrast sensitivity of luminance, red-green and blue-yellow: sums of Gaussians a sqrt(π/b) exp(-π²x²/b), x in degrees. */
const SENSITIVITY = [[[1, 0.0047]], [[1, 0.0053]], [[34.1, 0.04], [13.5, 0.025]]];
const WIDEST = 0.04;
const WHITE = /** @type {const} */ ([0.950428545, 1, 1.088900371]); // D65
const TO_XYZ = [0.4123907992659593, 0.357584339383878, 0.1804807884018343, 0.2126390058715103, 0.715168678767756, 0.07219231536073371, 0.01933081871559182, 0.11919477979462598, 0.9505321522496605];
const FROM_XYZ = inverse(TO_XYZ);

/** @typedef {Float32Array[]} Planes three of them */

/**
 * @param {Uint8Array | Uint8ClampedArray} a the reference: RGBA, sRGB-coded
 * @param {Uint8Array | Uint8ClampedArray} b
 * @param {number} width
 * @param {number} height
 * @returns {{map: Float32Array, mean: number}}
 */
export function flip(a, b, width, height) {
  const [first, second] = [a, b].map((picture) => ycxcz(picture, width * height));
  const map = new Float32Array(width * height);
  if (!first || !second) return { map, mean: 0 };
  const [labA, labB] = [first, second].map((planes) => perceivedColours(planes, width, height));
  const [edgesA, pointsA] = features(/** @type {Float32Array} */ (first[0]), width, height);
  const [edgesB, pointsB] = features(/** @type {Float32Array} */ (second[0]), width, height);
  const most = greatest();
  let sum = 0;
  for (let i = 0; i < map.length; i++) {
    const [l, m, n] = [0, 1, 2].map((c) => (labA?.[c]?.[i] ?? 0) - (labB?.[c]?.[i] ?? 0));
    const colour = spread((Math.abs(l ?? 0) + Math.hypot(m ?? 0, n ?? 0)) ** QC, most);
    const edge = Math.abs((edgesA?.[i] ?? 0) - (edgesB?.[i] ?? 0));
    const point = Math.abs((pointsA?.[i] ?? 0) - (pointsB?.[i] ?? 0));
    const feature = (Math.max(edge, point) / Math.SQRT2) ** QF;
    sum += map[i] = colour ** (1 - feature);
  }
  return { map, mean: sum / map.length };
}

/** Maximum colour difference, between green and blue, raised to the exponent. */
function greatest() {
  const [green, blue] = [[0, 1, 0], [0, 0, 1]].map((rgb) => hunt(...labOf(.../** @type {[number, number, number]} */ (rgb))));
  if (!green || !blue) return 1;
  return (Math.abs(green[0] - blue[0]) + Math.hypot(green[1] - blue[1], green[2] - blue[2])) ** QC;
}

/** @param {number} distance @param {number} most @returns {number} 0..1: small ones take most of it */
function spread(distance, most) {
  const knee = PC * most;
  return distance < knee ? (PT / knee) * distance : PT + ((distance - knee) / (most - knee)) * (1 - PT);
}

/** @param {Uint8Array | Uint8ClampedArray} rgba @param {number} pixels @returns {Planes} opponent colours, linear in light */
function ycxcz(rgba, pixels) {
  const linear = Float64Array.from({ length: 256 }, (_, v) => (v / 255 <= 0.04045 ? v / 255 / 12.92 : ((v / 255 + 0.055) / 1.055) ** 2.4));
  const planes = [0, 1, 2].map(() => new Float32Array(pixels));
  const [y, cx, cz] = /** @type {[Float32Array, Float32Array, Float32Array]} */ (planes);
  for (let i = 0; i < pixels; i++) {
    const [X, Y, Z] = times(TO_XYZ, linear[rgba[4 * i] ?? 0] ?? 0, linear[rgba[4 * i + 1] ?? 0] ?? 0, linear[rgba[4 * i + 2] ?? 0] ?? 0);
    const [x1, y1, z1] = [X / WHITE[0], Y / WHITE[1], Z / WHITE[2]];
    y[i] = 116 * y1 - 16;
    cx[i] = 500 * (x1 - y1);
    cz[i] = 200 * (y1 - z1);
  }
  return planes;
}

/**
 * The perceived colours: filtered by contrast sensitivity, in CIELAB with the Hunt effect.
 * @param {Planes} planes
 * @param {number} width
 * @param {number} height
 * @returns {Planes}
 */
function perceivedColours(planes, width, height) {
  const radius = Math.ceil(3 * Math.sqrt(WIDEST / (2 * Math.PI ** 2)) * PIXELS_PER_DEGREE);
  const filtered = planes.map((plane, c) => {
    const terms = (SENSITIVITY[c] ?? []).map(([a = 1, b = 1]) => {
      const taps = Float64Array.from({ length: 2 * radius + 1 }, (_, i) => Math.exp((-(Math.PI ** 2) * ((i - radius) / PIXELS_PER_DEGREE) ** 2) / b));
      return { weight: a * Math.sqrt(Math.PI / b), taps, sum: total(taps) };
    });
    const whole = terms.reduce((sum, term) => sum + term.weight * term.sum ** 2, 0);
    const out = new Float32Array(plane.length);
    for (const { weight, taps } of terms) {
      const part = separable(plane, width, height, taps, taps);
      for (let i = 0; i < out.length; i++) out[i] = (out[i] ?? 0) + (weight / whole) * (part[i] ?? 0);
    }
    return out;
  });
  const [py, px, pz] = /** @type {[Float32Array, Float32Array, Float32Array]} */ (filtered);
  const clamp = (/** @type {number} */ v) => Math.min(Math.max(v, 0), 1);
  for (let i = 0; i < py.length; i++) {
    const y1 = ((py[i] ?? 0) + 16) / 116;
    const x1 = (px[i] ?? 0) / 500 + y1;
    const z1 = y1 - (pz[i] ?? 0) / 200;
    const [r, g, b] = times(FROM_XYZ, x1 * WHITE[0], y1 * WHITE[1], z1 * WHITE[2]);
    [py[i], px[i], pz[i]] = /** @type {[number, number, number]} */ (hunt(...labOf(clamp(r), clamp(g), clamp(b))));
  }
  return filtered;
}

/**
 * Strength of edges and points.
 *
 * @param {Float32Array} y of ycxcz
 * @param {number} width
 * @param {number} height
 * @returns {Float32Array[]}
 */
function features(y, width, height) {
  const grey = y.map((v) => (v + 16) / 116);
  const deviation = 0.5 * FEATURE_WIDTH * PIXELS_PER_DEGREE;
  const radius = Math.ceil(3 * deviation);
  const at = Array.from({ length: 2 * radius + 1 }, (_, i) => i - radius);
  const bell = at.map((x) => Math.exp((-x * x) / (2 * deviation ** 2)));
  const smooth = Float64Array.from(bell, (v) => v / total(bell));
  return [at.map((x, i) => -x * (bell[i] ?? 0)), at.map((x, i) => ((x / deviation) ** 2 - 1) * (bell[i] ?? 0))].map((taps) => {
    const [up, down] = [1, -1].map((sign) => total(taps.map((v) => Math.max(sign * v, 0))));
    const detector = Float64Array.from(taps, (v) => v / ((v > 0 ? up : down) ?? 1));
    const across = separable(grey, width, height, detector, smooth);
    const along = separable(grey, width, height, smooth, detector);
    return across.map((v, i) => Math.hypot(v, along[i] ?? 0));
  });
}

/**
 * Applies a separable filter to a plane; edge pixels are repeated.
 *
 * @param {Float32Array} plane
 * @param {number} width
 * @param {number} height
 * @param {Float64Array} rows
 * @param {Float64Array} columns
 */
function separable(plane, width, height, rows, columns) {
  const between = new Float32Array(plane.length);
  const out = new Float32Array(plane.length);
  const r = (rows.length - 1) / 2;
  const padded = new Float64Array(width + 2 * r);
  for (let y = 0; y < height; y++) {
    const from = y * width;
    for (let x = 0; x < padded.length; x++) padded[x] = plane[from + Math.min(Math.max(x - r, 0), width - 1)] ?? 0;
    for (let x = 0; x < width; x++) {
      let sum = 0;
      for (let i = 0; i < rows.length; i++) sum += /** @type {number} */ (rows[i]) * /** @type {number} */ (padded[x + i]);
      between[from + x] = sum;
    }
  }
  const line = new Float64Array(width);
  for (let y = 0; y < height; y++) {
    line.fill(0);
    for (let i = 0; i < columns.length; i++) {
      const from = Math.min(Math.max(y + i - r, 0), height - 1) * width;
      const tap = /** @type {number} */ (columns[i]);
      for (let x = 0; x < width; x++) line[x] = /** @type {number} */ (line[x]) + tap * /** @type {number} */ (between[from + x]);
    }
    out.set(line, y * width);
  }
  return out;
}

/** @param {number} r @param {number} g @param {number} b linear @returns {[number, number, number]} CIELAB */
function labOf(r, g, b) {
  const [X, Y, Z] = times(TO_XYZ, r, g, b);
  const delta = 6 / 29;
  const f = (/** @type {number} */ t) => (t > delta ** 3 ? Math.cbrt(t) : t / (3 * delta ** 2) + 4 / 29);
  const [fx, fy, fz] = [f(X / WHITE[0]), f(Y / WHITE[1]), f(Z / WHITE[2])];
  return [116 * fy - 16, 500 * (fx - fy), 200 * (fy - fz)];
}

/**
 * The Hunt effect: darker colours are perceived as less chromatic.
 * @param {number} l
 * @param {number} a
 * @param {number} b
 * @returns {[number, number, number]}
 */
function hunt(l, a, b) {
  return [l, 0.01 * l * a, 0.01 * l * b];
}

/** @param {number[]} m @param {number} x @param {number} y @param {number} z @returns {[number, number, number]} */
function times(m, x, y, z) {
  const row = (/** @type {number} */ i) => (m[i] ?? 0) * x + (m[i + 1] ?? 0) * y + (m[i + 2] ?? 0) * z;
  return [row(0), row(3), row(6)];
}

/** @param {number[]} m of three rows */
function inverse(m) {
  const [a = 0, b = 0, c = 0, d = 0, e = 0, f = 0, g = 0, h = 0, i = 0] = m;
  const det = a * (e * i - f * h) - b * (d * i - f * g) + c * (d * h - e * g);
  return [e * i - f * h, c * h - b * i, b * f - c * e, f * g - d * i, a * i - c * g, c * d - a * f, d * h - e * g, b * g - a * h, a * e - b * d].map((v) => v / det);
}

/** @param {Iterable<number>} values */
function total(values) {
  let sum = 0;
  for (const value of values) sum += value;
  return sum;
}
