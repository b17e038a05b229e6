/** The shaders of a preview mesh's shadows: maps of depth from the light, and how much of the light each pixel misses. */

import { FLOOR_MAP_GLSL } from "./mesh-floor-shader.js";

/** Tiles of a batch: each is the depth of the scene seen from one direction. */
export const [ACROSS, TILES] = [4, 16];
/** Tiles of the lamps at most: six around each. */
export const MOST_LAMP_TILES = 24;

const HIDDEN_GLSL = `
uniform sampler2D image;
uniform int alphaMode; // 0: opaque, 1: mask, 2: blend
uniform float cutoff;
uniform float solid; // share of the light that the surface holds back
uniform bool isHalved; // it is either solid or not: other maps do not make up for the noise of this one
in vec3 place;
in vec4 shown;
in vec2 texel;
float hash(vec2 at) {
  return fract(52.9829189 * fract(dot(at, vec2(0.06711056, 0.00583715)))); // Jimenez 2014, interleaved gradient noise
}
bool isHidden() {
  float opacity = alphaMode == 0 ? 1.0 : shown.a * texture(image, texel).a;
  if (alphaMode == 1) return opacity < cutoff;
  return opacity * solid < 1.0 && opacity * solid <= (isHalved ? 0.5 : hash(gl_FragCoord.xy));
}`;

export const DEPTH_FRAGMENT = `#version 300 es
precision highp float;
${HIDDEN_GLSL}
void main() {
  if (isHidden()) discard;
}`;

/** What the camera sees: normals, beside the depth. */
export const NORMAL_FRAGMENT = `#version 300 es
precision highp float;
${HIDDEN_GLSL}
uniform vec4 eye;
in vec3 facing;
out vec4 pixel;
void main() {
  if (isHidden()) discard;
  vec3 flatly = normalize(cross(dFdx(place), dFdy(place)));
  if (dot(flatly, normalize(eye.xyz - eye.w * place)) < 0.0) flatly = -flatly;
  vec3 n = dot(facing, facing) > 0.01 ? normalize(facing) : flatly;
  pixel = vec4(0.5 + 0.5 * (dot(n, flatly) < 0.0 ? -n : n), 1.0);
}`;

/** Points of the scene, one for each pixel of what is written: those that the camera sees, or those of the floor. */
export const GATHER_VERTEX = `#version 300 es
uniform mat4 toClip;
flat out mat4 fromClip;
out vec2 at;
void main() {
  fromClip = inverse(toClip);
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(at, 0.0, 1.0);
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
  vec2 uv = 0.5 + 0.5 * at;
  place = corner + uv.x * alongX + uv.y * alongY + thick * (1.0 - texelFetch(base, ivec2(gl_FragCoord.xy), 0).r) * above;
  n = above;
  return true;
}
#else
flat in mat4 fromClip;
uniform sampler2D seenDepth;
uniform sampler2D seenNormal;
bool point(out vec3 place, out vec3 n) {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(seenDepth, pixel, 0).r;
  if (depth == 1.0) return false;
  vec4 found = fromClip * vec4(at, 2.0 * depth - 1.0, 1.0);
  place = found.xyz / found.w;
  n = normalize(2.0 * texelFetch(seenNormal, pixel, 0).rgb - 1.0);
  return true;
}
#endif`;

/**
 * Light from around that a point misses in a batch: that of the directions in which something else is seen, less what that reflects.
 */
export const GATHER_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DArrayShadow;
uniform sampler2DArrayShadow maps;
uniform float layer;
uniform int count; // of its directions
uniform float texelSize; // width of a map's texel, in the scene
uniform vec4 rows[${3 * TILES}]; // to the tiles' coordinates
uniform vec3 ways[${TILES}];
uniform vec3 colors[${TILES}];
uniform vec3 instead[${TILES}]; // what is seen in place of the light
in vec2 at;
out vec4 missed;
${POINT_GLSL}
#ifndef FLOOR
${FLOOR_MAP_GLSL}
const float SPREAD = 0.3; // half the angle between neighbouring directions of a batch, about
#endif
void main() {
  vec3 place, n;
  missed = vec4(0.0);
  if (!point(place, n)) return;
  for (int i = 0; i < count; i++) {
    float cosine = dot(n, ways[i]);
    if (cosine <= 0.0) continue;
    vec4 from = vec4(place + texelSize * (1.5 * n + ways[i]), 1.0);
    vec3 seen = vec3(dot(rows[3 * i], from), dot(rows[3 * i + 1], from), dot(rows[3 * i + 2], from));
    float open = 1.0;
    if (max(abs(seen.x), abs(seen.y)) < 0.995) {
      vec2 uv = (0.5 + 0.5 * seen.xy + vec2(i % ${ACROSS}, i / ${ACROSS})) / ${ACROSS}.0;
      open = texture(maps, vec4(uv, layer, clamp(0.5 + 0.5 * seen.z, 0.0, 1.0)));
    }
    vec3 lost = (1.0 - open) * (colors[i] - instead[i]);
#ifndef FLOOR
    // A direction below the horizon sees the floor, whose shadow is missing from the light.
    if (dot(ways[i], floorPlane.xyz) < 0.0) lost += open * colors[i] * min(missedFrom(place, ways[i], SPREAD) / max(floorRadiance, vec3(1e-6)), 1.0);
#endif
    missed.rgb += cosine * lost;
  }
}`;

/** Parts of four lamps' light that reach a point. */
export const LAMPS_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2DArrayShadow;
uniform sampler2DArrayShadow maps;
uniform float layer;
uniform int count;
uniform int across; // tiles in a row
uniform float texelWidth; // of a tile's
uniform float filled; // share of the map that the tiles fill, along a side
uniform mat4 toTile[${MOST_LAMP_TILES}];
uniform vec2 lampOf[${MOST_LAMP_TILES}]; // its number, and the width of a texel at distance 1, or of parallel light anywhere
uniform vec4 places[4]; // of the lamps, with 1, or directions to them, with 0
in vec2 at;
out vec4 part;
${POINT_GLSL}
void main() {
  vec3 place, n;
  vec4 open = vec4(1.0);
  part = open;
  if (!point(place, n)) return;
  for (int i = 0; i < count; i++) {
    int lamp = int(lampOf[i].x);
    vec3 way = places[lamp].xyz - places[lamp].w * place;
    float texelSize = lampOf[i].y * (places[lamp].w > 0.5 ? length(way) : 1.0);
    vec4 seen = toTile[i] * vec4(place + texelSize * (1.5 * n + normalize(way)), 1.0);
    if (seen.w <= 0.0 || max(abs(seen.x), abs(seen.y)) >= seen.w) continue;
    float depth = clamp(0.5 + 0.5 * seen.z / seen.w, 0.0, 1.0);
    float found = 0.0;
    for (int k = 0; k < 16; k++) { // each compares four texels
      vec2 step = vec2(k & 3, k >> 2) - 1.5;
      vec2 inTile = 0.5 + 0.5 * seen.xy / seen.w + texelWidth * step;
      vec2 uv = (clamp(inTile, texelWidth, 1.0 - texelWidth) + vec2(i % across, i / across)) * filled / float(across);
      vec2 weight = 2.0 - abs(step);
      found += weight.x * weight.y * texture(maps, vec4(uv, layer, depth)) / 16.0;
    }
    open[lamp] = min(open[lamp], found);
  }
  part = open;
}`;
