/**
 * Colour maps. False colour is Turbo (Mikhailov 2019, "Turbo, An Improved Rainbow Colormap for Visualization"), in the
 * polynomial fit that Google published with it; the heat map of a plane is the service's (renderer/aovs.py).
 */

/** Polynomial coefficients of red, green and blue, in ascending order. */
const TURBO = [
  [0.13572138, 4.6153926, -42.66032258, 132.13108234, -152.94239396, 59.28637943],
  [0.09140261, 2.19418839, 4.84296658, -14.18503333, 4.27729857, 2.82956604],
  [0.1066733, 12.64194608, -60.58204836, 110.36276771, -89.90310912, 27.34824973],
];

/** Range of false colour: stops above and below middle grey (0.18). */
export const FALSE_STOPS = 6;

const digits = (/** @type {number} */ v) => v.toFixed(8);

export const COLOUR_MAP_GLSL = `
vec3 turbo(float t) {
  float x = clamp(t, 0.0, 1.0);
  vec3 c = vec3(${TURBO.map((row) => digits(row[5] ?? 0)).join(", ")});
${[4, 3, 2, 1, 0].map((i) => `  c = c * x + vec3(${TURBO.map((row) => digits(row[i] ?? 0)).join(", ")});`).join("\n")}
  return clamp(c, 0.0, 1.0);
}

// Luminance in stops about middle grey.
vec3 falseColour(float luminance) {
  return turbo(0.5 + log2(max(luminance, 1e-10) / 0.18) / ${(2 * FALSE_STOPS).toFixed(1)});
}
`;

/** @param {number} t 0..1 @returns {[number, number, number]} as a screen shows it, 0..1 */
export function turbo(t) {
  const x = Math.min(Math.max(t, 0), 1);
  const [r = 0, g = 0, b = 0] = TURBO.map((row) =>
    Math.min(Math.max(row.reduceRight((sum, factor) => sum * x + factor, 0), 0), 1),
  );
  return [r, g, b];
}

/** The service's heat map for samples and error: equal steps from zero to the maximum. */
export const HEAT = [
  [0, 0, 0],
  [50, 25, 120],
  [190, 45, 100],
  [250, 140, 35],
  [255, 250, 195],
].map(([r = 0, g = 0, b = 0]) => /** @type {[number, number, number]} */ ([r / 255, g / 255, b / 255]));

/** @param {[number, number, number][]} colours at equal steps @returns {string} for CSS */
export const gradient = (colours) =>
  `linear-gradient(to right, ${colours.map((rgb) => `rgb(${rgb.map((v) => Math.round(v * 255)).join(" ")})`).join(", ")})`;

/** CSS gradient of a bar that shows `turbo`. */
export const turboGradient = () => gradient(Array.from({ length: 33 }, (_, i) => turbo(i / 32)));
