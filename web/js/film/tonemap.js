/**
 * The tone curves in GLSL, from exposed scene-linear Rec.709 to sRGB-coded display values. Same formulas as
 * renderer/image/tonemap.py, so that a downloaded PNG matches the page.
 */

import { t } from "../base/words.js";

/** In the order of the shader's `curve`; the shader has a function for each name. */
export const CURVES = [
  { name: "neutral", label: t("Neutral"), hint: t("Khronos PBR Neutral: true base colours, highlights roll off") },
  { name: "srgb", label: "sRGB", hint: t("No tone curve: values above 1 clip") },
  {
    name: "hue",
    label: t("Hue-preserving clip"),
    hint: t("A pixel above 1 is scaled by its greatest channel: no hue shifts"),
  },
  { name: "reinhard", label: "Reinhard", hint: t("x / (1 + luminance): soft and flat") },
  { name: "filmic", label: t("Filmic"), hint: t("ACES fit by Narkowicz: more contrast") },
  { name: "agx", label: "AgX", hint: t("Bright colours fade to white, as on film") },
];

export const DEFAULT_CURVE = "neutral";

export const TONEMAP_GLSL = `
vec3 srgbEncode(vec3 c) {
  c = clamp(c, 0.0, 1.0);
  return mix(12.92 * c, 1.055 * pow(c, vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308)));
}

// The encoding clips.
vec3 srgb(vec3 c) {
  return c;
}

// A pixel above 1 is scaled by its greatest channel.
vec3 hue(vec3 c) {
  return c / max(1.0, max(c.r, max(c.g, c.b)));
}

// Khronos PBR Neutral Tone Mapper, specification 1.0
vec3 neutral(vec3 c) {
  const float startCompression = 0.8 - 0.04;
  const float desaturation = 0.15;
  float x = min(c.r, min(c.g, c.b));
  c -= x < 0.08 ? x - 6.25 * x * x : 0.04;
  float peak = max(c.r, max(c.g, c.b));
  if (peak < startCompression) return c;
  float d = 1.0 - startCompression;
  float newPeak = 1.0 - d * d / (peak + d - startCompression);
  c *= newPeak / peak;
  float g = 1.0 - 1.0 / (desaturation * (peak - newPeak) + 1.0);
  return mix(c, vec3(newPeak), g);
}

// Reinhard et al. 2002, equation 3, on luminance
vec3 reinhard(vec3 c) {
  return c / (1.0 + dot(c, vec3(0.2126, 0.7152, 0.0722)));
}

// Narkowicz 2015, "ACES Filmic Tone Mapping Curve"
vec3 filmic(vec3 c) {
  c = min(c, 1e6);
  return (c * (2.51 * c + 0.03)) / (c * (2.43 * c + 0.59) + 0.14);
}

// AgX by Troy Sobotka; matrices and sigmoid fit by Benjamin Wrensch, "Minimal AgX Implementation"
vec3 agx(vec3 c) {
  const mat3 inset = mat3(0.842479062253094, 0.0423282422610123, 0.0423756549057051,
                          0.0784335999999992, 0.878468636469772, 0.0784336,
                          0.0792237451477643, 0.0791661274605434, 0.879142973793104);
  const mat3 outset = mat3(1.19687900512017, -0.0528968517574562, -0.0529716355144438,
                           -0.0980208811401368, 1.15190312990417, -0.0980434501171241,
                           -0.0990297440797205, -0.0989611768448433, 1.15107367264116);
  const float minEv = -12.47393;
  const float maxEv = 4.026069;
  c = inset * max(c, 0.0);
  vec3 x = (clamp(log2(max(c, 1e-10)), minEv, maxEv) - minEv) / (maxEv - minEv);
  vec3 x2 = x * x;
  vec3 x4 = x2 * x2;
  x = 15.5 * x4 * x2 - 40.14 * x4 * x + 31.96 * x4 - 6.868 * x2 * x + 0.4298 * x2 + 0.1191 * x - 0.00232;
  return pow(clamp(outset * x, 0.0, 1.0), vec3(2.2));
}

vec3 displayed(vec3 c, int curve) {
${CURVES.map(({ name }, i) => `  if (curve == ${i}) return srgbEncode(${name}(c));`).join("\n")}
  return c;
}
`;

/** Peak from which Khronos PBR Neutral compresses, and its desaturation: as in TONEMAP_GLSL. */
const [START, DESATURATION] = [0.8 - 0.04, 0.15];

/**
 * Returns the exposed radiance of a displayed pixel: the inverse of the default curve. White gives the least radiance that is displayed as white.
 *
 * @param {number[]} displayed sRGB, 0 to 255
 * @returns {[number, number, number]} linear
 */
export function undisplayed(displayed) {
  const coded = displayed.map((value) => Math.min(value, 254.5) / 255);
  let color = coded.map((value) => (value <= 0.04045 ? value / 12.92 : ((value + 0.055) / 1.055) ** 2.4));
  const shown = Math.max(...color);
  if (shown > START) {
    const d = 1 - START;
    const peak = (d * d) / (1 - shown) - d + START;
    const grey = 1 - 1 / (DESATURATION * (peak - shown) + 1);
    color = color.map((value) => (Math.max(value - grey * shown, 0) / (1 - grey)) * (peak / shown));
  }
  const least = Math.min(...color);
  const offset = least < 0.04 ? Math.sqrt(least / 6.25) - least : 0.04;
  const [r = 0, g = 0, b = 0] = color;
  return [r + offset, g + offset, b + offset];
}
