/** The shaders of a preview mesh's shadows: maps of depth from the light, and how much of the light each pixel misses. */

import { FLOOR_MAP_GLSL } from "./mesh-floor-shader.js";
import { EDGED_GLSL } from "./mesh-light-shader.js";

/** Tiles of the map of depth, in a row and in all: each shows the scene from one direction. */
export const [ACROSS, TILES] = [8, 64];
/** Directions that are gathered together. */
export const TOGETHER = 16;
/** Tiles of the lamps at most: six around each. */
export const MOST_LAMP_TILES = 24;

const HIDDEN_GLSL = `
uniform sampler2D image;
uniform int alphaMode; // 0: opaque, 1: mask, 2: blend
uniform float cutoff;
uniform float solid; // share of the light that the surface holds back
uniform float threshold; // differs from map to map, so that a surface is drawn in a share of the maps that equals its opacity
in vec3 place;
in vec4 shown;
centroid in vec2 texel;
bool isHidden() {
  float opacity = alphaMode == 0 ? 1.0 : shown.a * texture(image, texel).a;
  if (alphaMode == 1) return opacity < cutoff;
  return opacity * solid <= threshold;
}`;

export const DEPTH_FRAGMENT = `#version 300 es
precision highp float;
${HIDDEN_GLSL}
void main() {
  if (isHidden()) discard;
}`;

/** Depth from a lamp: one map for all thresholds, so they differ from texel to texel. Source: Bayer 1973, ordered dithering. */
export const LAMP_DEPTH_FRAGMENT = DEPTH_FRAGMENT.replace("uniform float threshold;", "float threshold;").replace(
  "if (isHidden())",
  `ivec2 at = ivec2(gl_FragCoord.xy), fine = at & 1, coarse = (at >> 1) & 1;
  threshold = (float(8 * (fine.x ^ fine.y) + 4 * fine.y + 2 * (coarse.x ^ coarse.y) + coarse.y) + 0.5) / 16.0;
  if (isHidden())`,
);

/** Finds what lies on the floor and faces upward, such as a sheet or the top of a plate. */
const LYING_GLSL = `
in vec3 facing;
uniform vec3 above; // normal of the floor
uniform float top; // height up to which what faces upward lies on it
bool isLying() {
  bool isUpward = dot(facing, facing) > 0.01 ? dot(facing, above) > 0.0 : gl_FrontFacing;
  return isUpward && dot(place, above) < top;
}`;

/** Depth of what lies on the floor. */
export const BASE_FRAGMENT = `#version 300 es
precision highp float;
${HIDDEN_GLSL}
${LYING_GLSL}
void main() {
  if (isHidden() || !isLying()) discard;
}`;

/** Albedo of the scene, without what lies on the floor: from below, a sheet would hide what stands on it. */
export const ALBEDO_FRAGMENT = `#version 300 es
precision highp float;
${HIDDEN_GLSL}
${LYING_GLSL}
out vec4 pixel;
void main() {
  if (isHidden() || isLying()) discard;
  vec3 color = mix(shown.rgb / 12.92, pow((shown.rgb + 0.055) / 1.055, vec3(2.4)), greaterThan(shown.rgb, vec3(0.04045)));
  pixel = vec4(color * texture(image, texel).rgb, 1.0);
}`;

/** Normals of the surfaces that the camera sees, with edges and smoothed; and as alpha, 0 for back faces. */
export const NORMAL_FRAGMENT = `#version 300 es
precision highp float;
${HIDDEN_GLSL}
uniform vec4 eye;
in vec3 facing;
${EDGED_GLSL}
layout(location = 0) out vec4 pixel;
layout(location = 1) out vec4 smoothed;
void main() {
  if (isHidden()) discard;
  vec3 flatly = normalize(cross(dFdx(place), dFdy(place)));
  if (dot(flatly, normalize(eye.xyz - eye.w * place)) < 0.0) flatly = -flatly;
  vec3 n = dot(facing, facing) > 0.01 ? normalize(facing) : flatly;
  bool isBack = dot(n, flatly) < 0.0;
  if (isBack) n = -n;
  pixel = vec4(0.5 + 0.5 * edged(n, flatly), isBack ? 0.0 : 1.0);
  smoothed = vec4(0.5 + 0.5 * n, 1.0);
}`;

/** Normal of the floor. */
export const FLOOR_NORMAL_FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 alongX;
uniform vec3 alongY;
layout(location = 0) out vec4 pixel;
layout(location = 1) out vec4 smoothed;
void main() {
  pixel = smoothed = vec4(0.5 + 0.5 * normalize(cross(alongX, alongY)), 1.0);
}`;

/** Points of the scene, one for each pixel of what is written: those that the camera sees, or those of the floor. */
export const GATHER_VERTEX = `#version 300 es
uniform mat4 toClip;
flat out mat4 fromClip;
void main() {
  fromClip = inverse(toClip);
  gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0, 0.0, 1.0);
}`;
const POINT_GLSL = `
#ifdef FLOOR
uniform vec3 corner; // of the floor's map
uniform vec3 alongX;
uniform vec3 alongY;
uniform vec3 above;
uniform sampler2D base; // depth of what lies on the floor, from above
uniform float thick; // height of depth 0 above the floor
bool point(out vec3 place, out vec3 n) {
  vec2 uv = gl_FragCoord.xy / vec2(textureSize(base, 0));
  place = corner + uv.x * alongX + uv.y * alongY + thick * (1.0 - texelFetch(base, ivec2(gl_FragCoord.xy), 0).r) * above;
  n = above;
  return true;
}
#else
flat in mat4 fromClip;
uniform sampler2D seenDepth;
uniform sampler2D seenNormal;
uniform int step; // pixels along a side that share one
// The pixel that a texel stands for.
ivec2 pixelOf(ivec2 texel) {
  return min(texel * step + step / 2, textureSize(seenDepth, 0) - 1);
}
vec3 normalAt(ivec2 pixel) {
  return normalize(2.0 * texelFetch(seenNormal, pixel, 0).rgb - 1.0);
}
bool pointAt(ivec2 pixel, float depth, out vec3 place, out vec3 n) {
  if (depth == 1.0) return false;
  vec2 at = 2.0 * (vec2(pixel) + 0.5) / vec2(textureSize(seenDepth, 0)) - 1.0;
  vec4 found = fromClip * vec4(at, 2.0 * depth - 1.0, 1.0);
  place = found.xyz / found.w;
  n = normalAt(pixel);
  return true;
}
// Slope of a surface's depth on the screen: that of a plane is the same everywhere.
vec2 slopeOf(vec3 place, vec3 n) {
  vec4 plane = vec4(n, -dot(n, place)) * fromClip;
  return -plane.xy / (abs(plane.z) < 1e-6 ? 1e-6 : plane.z) / vec2(textureSize(seenDepth, 0));
}
// How far another pixel shows the surface that a pixel shows, of a depth, slope and normal. gap: difference of its depth from the surface's
float alikeAt(ivec2 other, ivec2 pixel, float depth, vec2 slope, vec3 n, out float gap) {
  float along = dot(slope, vec2(other - pixel));
  gap = abs(texelFetch(seenDepth, other, 0).r - depth - along);
  return gap < 0.005 * (1.0 - depth) + 1e-4 + 0.3 * abs(along) ? smoothstep(0.5, 0.95, dot(n, normalAt(other))) : 0.0;
}
bool point(out vec3 place, out vec3 n) {
  ivec2 pixel = pixelOf(ivec2(gl_FragCoord.xy));
  return pointAt(pixel, texelFetch(seenDepth, pixel, 0).r, place, n);
}
#endif`;

/**
 * Light of the environment that a point misses: that of the directions in which something else is seen; and, as alpha, the luminance of the light of
 * all directions, shadowed or not. Their ratio is bounded however few the directions are.
 */
export const GATHER_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
uniform sampler2DShadow maps;
uniform int first; // of the directions
uniform int count;
uniform float texelSize; // width of a map's texel, in the scene
uniform vec4 rows[${3 * TOGETHER}]; // to the tiles' coordinates
uniform vec3 ways[${TOGETHER}];
uniform vec3 colors[${TOGETHER}];
uniform vec3 instead[${TOGETHER}]; // what is seen in place of the light, if it is white
uniform sampler2D albedos; // of the scene from below and, beside that, from above, multiplied by the share that is covered
uniform vec3 albedoX; // from the middle, to coordinates of a view
uniform vec3 albedoY;
uniform float halfHeight; // of the scene
uniform bool isAlone; // only lamps light the scene, and what is seen in place of other light is an estimate
layout(location = 0) out vec4 missed;
layout(location = 1) out vec4 given; // what is seen in place of the light that is missed, if all light reaches it
layout(location = 2) out vec2 away; // how far what hides the light is, weighted by the light, and the sum of the weights
uniform sampler2D mapDepth; // the maps, without comparison
uniform float depthRange; // of the maps, in the scene
${EDGED_GLSL}
${POINT_GLSL}
const vec3 USUAL = vec3(0.6); // albedo of what is seen from neither side: of vertical sheets
// Mean albedo around a place. view: 0: from below, 1: from above.
vec3 albedoAt(vec3 place, float view, float level) {
  vec2 uv = clamp(0.5 + vec2(dot(place, albedoX), dot(place, albedoY)), 0.05, 0.95);
  uv = 0.5 * (uv + vec2(view, 0.0));
  vec4 found = textureLod(albedos, uv, level);
  if (found.a < 0.04) found = textureLod(albedos, uv, 5.0); // it is beside the scene
  return isAlone ? vec3(1.0) : mix(USUAL, found.rgb / max(found.a, 1e-3), smoothstep(0.0, 0.004, found.a));
}
#ifdef FLOOR
uniform sampler2D under; // depth of the scene from below, in a quarter
const float COVERED = 0.02; // weight of floor inside what stands on it, which would darken the floor beside that
const float STANDING = 0.014; // height up to which something stands on the floor, in parts of the maps' depth
// Whether something stands on the floor at a place.
bool isStood(vec3 place) {
  vec2 uv = 0.5 + vec2(dot(place, albedoX), dot(place, albedoY));
  return uv == clamp(uv, 0.0, 1.0) && halfHeight + depthRange * (textureLod(under, 0.5 * uv, 0.0).r - 0.5) < STANDING * depthRange;
}
#else
${FLOOR_MAP_GLSL}
uniform sampler2D seenSmoothed;
uniform sampler2D floorReflected; // as GIVEN_FRAGMENT writes it
const float SPREAD = 0.3; // half the angle between neighbouring directions of a batch, about
// Colour of what lies below the scene along a direction, in proportion to its luminance; white where nothing does.
vec3 groundAlong(vec3 place, vec3 way, vec3 up) {
  float down = -dot(up, way);
  if (down <= 0.0) return vec3(1.0);
  place += max(dot(place, up) + halfHeight, 0.0) / max(down, 0.05) * way;
  vec2 uv = clamp(0.5 + vec2(dot(place, albedoX), dot(place, albedoY)), 0.05, 0.95);
  vec4 found = textureLod(albedos, 0.5 * uv, 3.0); // from below, where no body hides it
  float luminance = dot(found.rgb, LUMINANCE);
  return mix(vec3(1.0), found.rgb / max(luminance, 1e-3), found.a * min(20.0 * luminance, 1.0));
}
#endif
#ifndef FLOOR
// Light that a point of the floor misses, from what is hidden there: less what surfaces reflect onto it, and as the map has it where the shadow is wide (of the studio's floor, FLOOR_FRAGMENT does that before). Both in proportion to the luminance of all light.
vec3 missedOnFloor(vec3 place, vec3 hidden) {
  vec2 uv = 0.5 + vec2(dot(place, floorX), dot(place, floorY));
  vec4 known = textureLod(floorMissed, uv, 0.0);
  return mix(hidden - textureLod(floorReflected, uv, 0.0).rgb, known.rgb, smoothstep(NARROW, 2.0 * NARROW, known.a));
}
#endif
const float WITHIN = 0.75; // part of the light that comes from behind the surface, compared with that of other surfaces
const float GRAZING = 0.1; // cosine to a triangle's normal from which all light reaches its points
void main() {
  vec3 place, edge;
  missed = given = vec4(0.0);
  away = vec2(0.0);
#ifdef FLOOR
  bool isCovered = true; // no light reaches it
#endif
  if (!point(place, edge)) return;
#ifdef FLOOR
  vec3 n = edge;
#else
  vec3 fromBelow = albedoAt(place, 0.0, 4.0), fromAbove = albedoAt(place, 1.0, 4.0); // blurred: else the colour of a roof would show below it
  vec3 up = cross(albedoX, albedoY) / dot(albedoX, albedoX);
  vec3 n = normalize(2.0 * texelFetch(seenSmoothed, pixelOf(ivec2(gl_FragCoord.xy)), 0).rgb - 1.0);
  float bent = bentOf(n, edge);
  bool isFloor = dot(edge, floorPlane.xyz) > 0.99 && abs(dot(place, floorPlane.xyz) - floorPlane.w) < texelSize;
#endif
  for (int i = 0; i < count; i++) {
    float cosine = dot(n, ways[i]);
    if (cosine <= 0.0) continue;
    vec4 from = vec4(place + texelSize * (1.5 * edge + ways[i]), 1.0);
    vec3 seen = vec3(dot(rows[3 * i], from), dot(rows[3 * i + 1], from), dot(rows[3 * i + 2], from));
    float open = 1.0, above = 1.0;
#ifndef FLOOR
    above = max(1.0 - bent, smoothstep(0.0, GRAZING, dot(edge, ways[i]))); // such a normal faces directions that are behind the surface
#endif
    if (max(abs(seen.x), abs(seen.y)) < 0.995) {
      int tile = first + i;
      vec2 uv = (0.5 + 0.5 * seen.xy + vec2(tile % ${ACROSS}, tile / ${ACROSS})) / ${ACROSS}.0;
      float depth = clamp(0.5 + 0.5 * seen.z, 0.0, 1.0);
      open = texture(maps, vec3(uv, depth));
      float hidden = cosine * (1.0 - open) * above * dot(colors[i], vec3(0.2126, 0.7152, 0.0722));
      if (hidden > 0.0) {
        float far = depthRange * max(depth - textureLod(mapDepth, uv, 0.0).r, 0.0);
        away += hidden * vec2(far, 1.0);
#ifdef FLOOR
        given.rgb += cosine * (1.0 - open) * instead[i] * albedoAt(place + far * ways[i], 0.0, 2.0);
#endif
      }
    }
#ifdef FLOOR
    isCovered = isCovered && open == 0.0;
    vec3 lost = (1.0 - open) * colors[i];
#else
    open *= above;
    vec3 reflecting = isAlone ? groundAlong(place, ways[i], up) : mix(fromAbove, fromBelow, 0.5 + 0.5 * dot(up, ways[i]));
    vec3 lost = (1.0 - open) * colors[i];
    if (!isFloor) given.rgb += cosine * (1.0 - open) * mix(WITHIN, 1.0, above) * instead[i] * reflecting;
    // A direction below the horizon sees the floor, whose shadow is missing from the light.
    if (dot(ways[i], floorPlane.xyz) < 0.0) lost += open * colors[i] * min(missedFrom(place, ways[i], SPREAD) / max(floorRadiance, vec3(1e-6)), 1.0);
#endif
    missed += cosine * vec4(lost, dot(colors[i], vec3(0.2126, 0.7152, 0.0722)));
  }
#ifdef FLOOR
  if (isCovered && isStood(place)) {
    missed *= COVERED;
    given *= COVERED;
    away *= COVERED;
  }
#else
  if (isFloor) missed.rgb = missed.a * missedOnFloor(place, missed.rgb / max(missed.a, 1e-9));
#endif
}`;

/**
 * Light that the floor misses: that of the directions in which something else is seen, less what that reflects. A surface above the floor sees
 * the floor around, and reflects as much less as that lacks light.
 */
export const GIVEN_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D hidden; // as GATHER_FRAGMENT writes them
uniform sampler2D given;
uniform sampler2D under; // depth of the scene from below, in a quarter
uniform float texelWidth; // of a texel of that, in texels of the floor's map
uniform float perDepth; // height in texels of the floor's map, by depth
uniform float ground; // depth of the floor
uniform sampler2D openSuns; // as LAMPS_FRAGMENT writes it
uniform vec4 suns; // part of the floor's light that comes from each lamp
uniform float most; // factor of what is given where all light reaches the floor around
uniform float power; // by which it depends on that light
layout(location = 0) out vec4 missed; // in proportion to the luminance of all light; and the width of its shadow in texels
layout(location = 1) out vec4 reflected; // the part of it that surfaces reflect, likewise
uniform sampler2D floorAway;
uniform float softness; // half the angle between neighbouring directions, times the texels of the map in a unit of the scene
const float MOST_SEEN = 8.0; // texels around that a surface above sees at most: what is beside the scene is seen from its sides
const int TAPS = 12;
const float WIDEST = 2.4; // reach of the blur, in widths of a shadow
const float BESIDE = 4.0; // texels around a covered one, at most, from which it takes what the floor beside it misses
const float UNCOVERED = 0.2; // part of these that is not covered, at least
const float UNSHADOWED = 100.0; // width where there is no shadow: wider than any that matters
// Height of what is above the floor, in texels.
float heightAbove() {
  ivec2 size = textureSize(under, 0) / 2;
  vec2 middle = vec2(size) * 0.5 + (gl_FragCoord.xy - 0.5 * vec2(textureSize(hidden, 0))) / texelWidth;
  float sum = 0.0;
  for (int i = 0; i < 9; i++) {
    ivec2 texel = clamp(ivec2(middle + vec2(i % 3 - 1, i / 3 - 1) / texelWidth), ivec2(0), size - 1);
    sum += texelFetch(under, texel, 0).r;
  }
  return max(sum / 9.0 - ground, 0.0) * perDepth;
}
void main() {
  vec2 size = vec2(textureSize(hidden, 0)), uv = gl_FragCoord.xy / size;
  // Shadows of single directions join if each is as wide as the angle between them: the farther what casts it, the wider. Mipmaps alone would show their outlines.
  vec2 close = textureLod(floorAway, uv, 3.0).rg, away = close + 0.05 * textureLod(floorAway, uv, 5.0).rg;
  float wide = softness * away.x / max(away.y, 1e-9);
  missed = vec4(vec3(0.0), UNSHADOWED);
  reflected = vec4(0.0);
  if (textureLod(hidden, uv, log2(1.0 + WIDEST * wide) + 1.0).rgb == vec3(0.0)) return;
  float height = heightAbove(), level = log2(1.0 + min(height, MOST_SEEN));
  float mean = textureLod(hidden, uv, log2(size.x)).a, beside = 0.0;
  if (textureLod(hidden, uv, 0.0).a < 0.5 * mean) { // it is covered
    beside = 0.5; // as near as possible: the floor is darkest along what stands on it
    while (beside < BESIDE && textureLod(hidden, uv, log2(1.0 + 2.0 * beside)).a < UNCOVERED * mean) beside *= 2.0;
    level = max(level, log2(1.0 + 2.0 * beside));
  }
  vec4 around = textureLod(hidden, uv, level);
  float open = 1.0 - dot(around.rgb, vec3(0.2126, 0.7152, 0.0722)) / max(around.a, 1e-9);
  open = clamp(open * (1.0 - dot(suns, vec4(1.0))) + dot(suns, textureLod(openSuns, uv, level)), 0.001, 1.0);
  wide = beside > 0.0 ? beside : min(wide, 0.5 * height); // the maps have the depth of the scene's upper side
  vec4 all = vec4(0.0);
  vec3 back = vec3(0.0);
  float total = 0.0;
  for (int i = 0; i < TAPS; i++) {
    float turn = 2.399963 * float(i), share = (float(i) + 0.5) / float(TAPS); // a spiral by the golden angle
    vec2 at = uv + WIDEST * wide * sqrt(share) * vec2(cos(turn), sin(turn)) / size;
    float weight = exp(-2.0 * share);
    all += weight * textureLod(hidden, at, log2(1.0 + 0.6 * wide));
    back += weight * textureLod(given, at, log2(1.0 + 0.6 * wide)).rgb;
    total += weight;
  }
  all /= total;
  back *= most * pow(open, power) / total;
  missed = vec4((all.rgb - back) / max(all.a, 1e-9), close.y > 0.0 ? min(softness * close.x / close.y, UNSHADOWED) : UNSHADOWED);
  reflected = vec4(back / max(all.a, 1e-9), 1.0);
}`;

/**
 * Light that what the camera sees misses, less what surfaces reflect in its place. These are about as open to the light as what they surround: in a
 * cavity, they reflect little. The shadows of single directions are blurred until they join: the farther what casts them, the more.
 */
export const REFLECTED_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D hidden; // as GATHER_FRAGMENT writes them
uniform sampler2D given;
uniform sampler2D hiddenAway;
uniform bool isAlone; // as there: the light around is what surfaces reflect
uniform float softness; // half the angle between neighbouring directions
uniform float most; // light that the blur may move: what casts a shadow can be nearer than the maps show
uniform mat4 toClip;
out vec4 missed;
${POINT_GLSL}
const float OPEN = 0.45; // part of the light that reaches a point from which all of it reaches the surfaces around; chosen by comparison with path-traced pictures
const int TAPS = 16;
const float WIDEST = 2.0, MOST_PIXELS = 24.0; // reach of the blur, in widths of a shadow, and at most
void main() {
  ivec2 texel = ivec2(gl_FragCoord.xy), pixel = pixelOf(texel), last = textureSize(hidden, 0) - 1;
  missed = texelFetch(hidden, texel, 0);
  vec3 back = texelFetch(given, texel, 0).rgb, place, n;
  vec2 away = texelFetch(hiddenAway, texel, 0).rg;
  float depth = texelFetch(seenDepth, pixel, 0).r;
  if (!pointAt(pixel, depth, place, n)) return;
  float perUnit = 0.5 * float(textureSize(seenDepth, 0).x) * length(vec3(toClip[0][0], toClip[1][0], toClip[2][0])) / (toClip * vec4(place, 1.0)).w; // pixels
  float wide = min(WIDEST * softness * away.x / max(away.y, 1e-9) * perUnit, MOST_PIXELS);
  if (step == 1 && wide > 1.0) { // coarsely, the points are blurred anyway
    vec2 slope = slopeOf(place, n);
    vec4 all = missed;
    vec3 allBack = back;
    vec2 allAway = away;
    float total = 1.0, gap;
    for (int i = 0; i < TAPS; i++) {
      float turn = 2.399963 * float(i), share = (float(i) + 0.5) / float(TAPS); // a spiral by the golden angle
      ivec2 tap = clamp(texel + ivec2(round(wide * sqrt(share) * vec2(cos(turn), sin(turn)))), ivec2(0), last);
      float weight = exp(-2.0 * share) * alikeAt(pixelOf(tap), pixel, depth, slope, n, gap);
      if (weight == 0.0) continue;
      all += weight * texelFetch(hidden, tap, 0);
      allBack += weight * texelFetch(given, tap, 0).rgb;
      allAway += weight * texelFetch(hiddenAway, tap, 0).rg;
      total += weight;
    }
    float part = min(most / max(abs(dot(all.rgb / total - missed.rgb, vec3(0.2126, 0.7152, 0.0722))), 1e-9), 1.0);
    missed = mix(missed, all / total, part);
    back = mix(back, allBack / total, part);
    away = mix(away, allAway / total, part);
  }
  missed.rgb -= (isAlone ? 1.0 : smoothstep(0.0, OPEN, 1.0 - away.y / max(missed.a, 1e-9))) * back;
}`;

/** Blurs what is missed along a surface, and divides it by the light of all directions. */
export const SMOOTH_FRAGMENT = `#version 300 es
precision highp float;
uniform sampler2D raw; // as REFLECTED_FRAGMENT writes it
out vec4 missed;
${POINT_GLSL}
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(seenDepth, pixel, 0).r;
  vec3 place, n;
  missed = vec4(0.0);
  if (!pointAt(pixel, depth, place, n)) return;
  vec2 slope = slopeOf(place, n);
  vec2 at = vec2(pixel - step / 2) / float(step);
  ivec2 corner = ivec2(floor(at)) - 1;
  vec4 sum = vec4(0.0);
  for (int k = 0; k < 16; k++) {
    ivec2 texel = corner + ivec2(k & 3, k >> 2);
    vec2 near = 2.0 - abs(vec2(texel) - at);
    texel = clamp(texel, ivec2(0), textureSize(raw, 0) - 1);
    ivec2 other = pixelOf(texel);
    float gap, alike = alikeAt(other, pixel, depth, slope, n, gap);
    sum += near.x * near.y * (alike + 1e-5 / (1.0 + 1e3 * gap)) * texelFetch(raw, texel, 0);
  }
  missed = vec4(sum.rgb / max(sum.a, 1e-9), 1.0);
}`;

/** Parts of four lamps' light that reach a point. */
export const LAMPS_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DShadow;
uniform sampler2DShadow maps;
uniform int count;
uniform int across; // tiles in a row
uniform float texelWidth; // of a tile's
uniform float filled; // share of the map that the tiles fill, along a side
uniform mat4 toTile[${MOST_LAMP_TILES}];
uniform vec2 lampOf[${MOST_LAMP_TILES}]; // its number, and the width of a texel at distance 1, or of parallel light anywhere
uniform vec4 places[4]; // of the lamps, with 1, or directions to them, with 0
out vec4 part;
${POINT_GLSL}
#ifndef FLOOR
// Offset in the scene from a place to the point of its tangent plane that lies so many pixels away from it on the screen. n: normal of the plane.
vec3 beside(vec3 place, vec3 n, vec2 pixels) {
  vec2 at = 2.0 * (gl_FragCoord.xy + pixels) / vec2(textureSize(seenDepth, 0)) - 1.0;
  vec4 near = fromClip * vec4(at, -1.0, 1.0), far = fromClip * vec4(at, 1.0, 1.0);
  vec3 from = near.xyz / near.w, way = far.xyz / far.w - from;
  return from + dot(n, place - from) / dot(n, way) * way - place;
}
#endif
const float MOST_STEP = 0.01; // of a tile's width
// Step between samples in a lamp's tile, for an offset in the scene.
vec3 stepOf(mat4 toTile, vec4 seen, vec3 way) {
  vec4 moved = toTile * vec4(way, 0.0);
  vec3 found = 0.25 * (moved.xyz - moved.w * seen.xyz / seen.w) / seen.w;
  return found * min(1.0, MOST_STEP / max(length(found.xy), 1e-9));
}
void main() {
  vec3 place, n;
  vec4 open = vec4(1.0);
  part = open;
  if (!point(place, n)) return;
  vec3 right = vec3(0.0), upward = vec3(0.0);
#ifndef FLOOR
  right = beside(place, n, vec2(1.0, 0.0));
  upward = beside(place, n, vec2(0.0, 1.0));
#endif
  for (int i = 0; i < count; i++) {
    int lamp = int(lampOf[i].x);
    vec3 way = places[lamp].xyz - places[lamp].w * place;
    float texelSize = lampOf[i].y * (places[lamp].w > 0.5 ? length(way) : 1.0);
    vec4 seen = toTile[i] * vec4(place + texelSize * (1.5 * n + normalize(way)), 1.0);
    if (seen.w <= 0.0 || max(abs(seen.x), abs(seen.y)) >= seen.w) continue;
    // The filter is as wide as the pixel, or the map's texels where these are wider.
    vec3 middle = 0.5 + 0.5 * seen.xyz / seen.w;
    vec3 x = stepOf(toTile[i], seen, right), y = stepOf(toTile[i], seen, upward);
    float found = 0.0;
    for (int k = 0; k < 16; k++) { // each compares four texels
      vec2 step = vec2(k & 3, k >> 2) - 1.5;
      vec2 inTile = middle.xy + texelWidth * step + step.x * x.xy + step.y * y.xy;
      float depth = clamp(middle.z + min(step.x * x.z + step.y * y.z, 0.0), 0.0, 1.0);
      vec2 uv = (clamp(inTile, texelWidth, 1.0 - texelWidth) + vec2(i % across, i / across)) * filled / float(across);
      vec2 weight = 2.0 - abs(step);
      found += weight.x * weight.y * texture(maps, vec3(uv, depth)) / 16.0;
    }
    open[lamp] = min(open[lamp], found);
  }
  part = open;
}`;
