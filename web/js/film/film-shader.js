/** The shader that shows a film: resampling, exposure, tone curve, sRGB. */

import { COLOUR_MAP_GLSL } from "./colour-map.js";
import { DISPLAY, LOGARITHMIC } from "./film-layer.js";
import { CURVES, TONEMAP_GLSL } from "./tonemap.js";
import { VIEW_TABLE_GLSL } from "./view-tables.js";
import { t } from "../base/words.js";

/** Displayable parts of the light, in the order of the shader's `part`. */
export const PARTS = [
  { name: "", label: "RGB", hint: t("Colour") },
  { name: "r", label: "R", hint: t("Red alone, as grey") },
  { name: "g", label: "G", hint: t("Green alone, as grey") },
  { name: "b", label: "B", hint: t("Blue alone, as grey") },
  { name: "y", label: t("Luminance"), hint: t("Luminance, as grey") },
  { name: "false", label: t("False colour"), hint: t("Luminance in false colour: a colour for every stop") },
];

/** @param {string} name @returns {number} */
export const partIndex = (name) =>
  Math.max(
    0,
    PARTS.findIndex((part) => part.name === name),
  );

export const VERTEX = `#version 300 es
void main() {
  // One triangle that covers the screen.
  vec2 p = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
  gl_Position = vec4(p, 0.0, 1.0);
}`;

/** The shader's number for the view in its table. */
export const VIEW_CURVE = CURVES.length;

export const FRAGMENT = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp sampler3D;

uniform sampler2D film;      // of coding, row 0 at the top
uniform vec2 canvasSize;     // device pixels
uniform vec2 origin;         // of the picture on the canvas, from the upper left corner
uniform float scale;         // device pixels per picture pixel
uniform float gain;          // 2^exposure, of a draft relative to its own
uniform int curve;
uniform sampler3D viewTable; // of an OpenColorIO view, instead of a curve
uniform int coding;          // linear RGB, sRGB-coded display values, or the logarithms of a draft (protocol/pictures.py)
uniform int part;
uniform sampler2D alpha;     // the film's coverage, as grey, where hasAlpha is set
uniform bool hasAlpha;
uniform float square;        // side of the checkerboard's squares, in device pixels
uniform bool high;           // the target is of high dynamic range, and its first row is the upper one
out vec4 color;

// At most this many texels an axis are averaged; beyond, they are taken at equal steps.
const int MAX_TAPS = 12;

${TONEMAP_GLSL}
${VIEW_TABLE_GLSL}
${COLOUR_MAP_GLSL}
vec3 shown(vec3 c) {
  float y = dot(c, vec3(0.2126, 0.7152, 0.0722));
  if (part == 5) return falseColour(y);
  if (part > 0) c = vec3(part == 1 ? c.r : part == 2 ? c.g : part == 3 ? c.b : y);
  return curve == ${VIEW_CURVE} ? viewed(c) : displayed(c, curve);
}

vec3 srgbDecode(vec3 v) {
  return mix(v / 12.92, pow((v + 0.055) / 1.055, vec3(2.4)), greaterThan(v, vec3(0.04045)));
}

// Without an upper bound
vec3 srgbExtended(vec3 c) {
  return mix(12.92 * c, 1.055 * pow(max(c, 0.0), vec3(1.0 / 2.4)) - 0.055, greaterThan(c, vec3(0.0031308)));
}

// Values above 1 approach 1000 nits at a white of 203, as highlights_rolled of renderer/image/hdr_still.py
vec3 highlightsRolled(vec3 c) {
  const float room = 1000.0 / 203.0 - 1.0;
  float brightest = max(c.r, max(c.g, c.b));
  return brightest > 1.0 ? c * (1.0 + room * (1.0 - exp((1.0 - brightest) / room))) / brightest : c;
}

// The rendition of high dynamic range of a JPEG with a gain map (renderer/image/gain_map.py): that of the curve up to middle
// grey, and the radiance above white.
vec3 highRange(vec3 c) {
  const vec3 weights = vec3(0.2126, 0.7152, 0.0722);
  const float offset = 1.0 / 64.0;
  vec3 ordinary = srgbDecode(shown(c));
  float base = dot(ordinary, weights);
  float middle = srgbDecode(shown(vec3(0.18))).r;
  float bright = dot(highlightsRolled(c * (middle / 0.18)), weights);
  float share = clamp((bright - middle) / (1.0 - middle), 0.0, 1.0);
  float stops = log2((max(bright, base) + offset) / (base + offset)) * share * share * (3.0 - 2.0 * share);
  return srgbExtended((ordinary + offset) * exp2(stops) - offset);
}

// Display values of premultiplied light before a checkerboard, as a PNG with straight alpha has them.
vec3 beforeSquares(vec3 linear, float coverage, vec2 p) {
  ivec2 at = ivec2(floor(p / square));
  vec3 behind = vec3(((at.x + at.y) & 1) == 0 ? 0.46 : 0.34);
  return coverage > 0.0 ? mix(behind, shown(linear * gain / coverage), coverage) : behind;
}

// The mean of the film over the screen pixel's footprint, every texel weighted by the area that it covers. At whole
// scales above 1 this is the nearest texel exactly; at scales between, edges stay sharp and even; below 1 nothing aliases.
vec3 footprint(sampler2D picture, vec2 lo, vec2 hi) {
  ivec2 size = textureSize(picture, 0);
  ivec2 first = ivec2(floor(lo + 1e-4));
  ivec2 last = ivec2(ceil(hi - 1e-4)) - 1;
  ivec2 stride = max(ivec2(1), (last - first + MAX_TAPS) / MAX_TAPS);
  vec3 sum = vec3(0.0);
  float area = 0.0;
  for (int y = first.y; y <= last.y; y += stride.y) {
    float wy = min(float(y + 1), hi.y) - max(float(y), lo.y);
    for (int x = first.x; x <= last.x; x += stride.x) {
      float w = wy * (min(float(x + 1), hi.x) - max(float(x), lo.x));
      sum += w * texelFetch(picture, clamp(ivec2(x, y), ivec2(0), size - 1), 0).rgb;
      area += w;
    }
  }
  return sum / area;
}

void main() {
  vec2 p = vec2(gl_FragCoord.x, high ? gl_FragCoord.y : canvasSize.y - gl_FragCoord.y);
  vec2 lo = (p - 0.5 - origin) / scale;
  vec2 hi = (p + 0.5 - origin) / scale;
  vec2 size = vec2(textureSize(film, 0));
  vec2 centre = 0.5 * (lo + hi);
  if (any(lessThan(centre, vec2(0.0))) || any(greaterThanEqual(centre, size))) {
    color = vec4(0.0);
    return;
  }
  vec3 linear = footprint(film, lo, hi);
  if (coding == ${LOGARITHMIC}) linear = (exp2(12.0 * linear) - 1.0) / 255.0;
  bool raw = coding == ${DISPLAY};
  color = vec4(raw ? linear : shown(linear * gain), 1.0);
  if (high && !raw && part == 0) color.rgb = highRange(linear * gain);
  if (hasAlpha && part == 0) color = vec4(beforeSquares(linear, footprint(alpha, lo, hi).r, p), 1.0);
}`;

/**
 * @param {string} name
 * @returns {number} the number that the shader knows a curve by
 */
export function curveIndex(name) {
  return Math.max(
    0,
    CURVES.findIndex((c) => c.name === name),
  );
}
