/** The shaders of a preview mesh: metals, dielectrics and glass in the light around them and of lamps. Their shadows are computed before (mesh-shadow.js). */

import { TONEMAP_GLSL } from "../film/tonemap.js";
import { KEPT_GLSL } from "./kept-picture.js";
import { LIGHT_GLSL } from "./mesh-light-shader.js";

/** Passes, in the order in which they are drawn. */
export const PASS = { opaque: 0, glass: 1, blend: 2 };

/** Locations of the attributes, the same in all programs. */
export const PLACES = { share: 0, normal: 1, color: 2, uv: 3 };

const ATTRIBUTES = `
uniform mat4 toClip;
layout(location = ${PLACES.share}) in vec3 share;
layout(location = ${PLACES.normal}) in vec3 normal;
layout(location = ${PLACES.color}) in vec4 color;
layout(location = ${PLACES.uv}) in vec2 uv;
out vec3 place;
out vec4 shown;
centroid out vec2 texel;`;
const PLACE = `
  texel = uv;
  place = (share - 0.5) * extent;
  shown = color;
  gl_Position = toClip * vec4(place, 1.0);`;
export const VERTEX = `#version 300 es
uniform vec3 extent;
${ATTRIBUTES}
out vec3 facing;
void main() {
  ${PLACE}
  facing = normal;
}`;

/** What is drawn of radiance times gain with the default curve. */
const ENCODED_GLSL = `
${TONEMAP_GLSL}
uniform bool isForMirrors; // what is drawn is read as radiance
const float MOST = 1000.0; // half floats would overflow
vec3 encoded(vec3 c) {
  return isForMirrors ? min(c, MOST) : srgbEncode(neutral(c));
}`;

/**
 * For triangles about as small as pixels: shaded at the vertices, since their pixels, with those around them that the hardware shades too,
 * are several times as many. The tone curve is the default one.
 */
export const DENSE_VERTEX = `#version 300 es
#define AT_VERTICES
precision highp float;
precision highp sampler2D;
uniform vec3 emission;
uniform bool isWhole; // no texture and no picture is to be added
${LIGHT_GLSL}
${ENCODED_GLSL}
${ATTRIBUTES}
out vec3 lit;
out vec3 shine;
void main() {
  ${PLACE}
  vec3 v = normalize(eye.xyz - eye.w * place);
  vec3 n = normalize(normal);
  if (dot(n, v) < 0.0) n = -n;
  vec3 base = srgbDecode(color.rgb);
  float passed;
  vec3 missed = vec3(0.0);
  vec4 open = vec4(1.0);
#ifdef SHADOWS
  vec3 seen = gl_Position.xyz / gl_Position.w * 0.5 + 0.5;
  shadowsAt(seen.xy / perPixel, seen.z, 0.0, n, missed, open);
#endif
  shade(place, n, v, base, roughness, metallic, missed, open, lit, shine, passed);
  lit *= passed * base;
  if (isWhole) lit = encoded((lit + shine + emission) * gain);
}`;

const KEPT = `
#ifdef KEPT
${KEPT_GLSL}
#endif`;

/** What both fragment shaders write. */
const WRITE_GLSL = `
uniform int curve;
uniform int pass;
uniform sampler2D image;
uniform vec3 emission;
uniform bool unlit;
uniform int alphaMode; // 0: opaque, 1: mask, 2: blend
uniform float cutoff;
${ENCODED_GLSL}
centroid in vec2 texel;
in vec3 place;
in vec4 shown;
out vec4 pixel;
const float SHARPER = -1.0; // bias of the level of detail: coarse mipmaps mix colours that are neighbours in a texture but not on the surface
const float BLURRED = 1.0; // the same in mirrors: those that are curved magnify the edges of a texture, which would be jagged
const float SOLID = 0.98; // opacity from which blended surfaces are drawn with the opaque ones
bool isHidden(float opacity) {
  return (alphaMode == 1 && opacity < cutoff) || (alphaMode == 2 && (pass == ${PASS.blend}) == (opacity >= SOLID));
}
vec3 faceNormal(vec3 v) {
  vec3 n = normalize(cross(dFdx(place), dFdy(place)));
  return dot(n, v) < 0.0 ? -n : n;
}
void write(vec3 color, float opacity, vec3 flatly) {
#ifdef KEPT
  vec4 known = keptAt(place, flatly, 0.0);
  color = mix(color * keptLight(place), known.rgb, known.a);
#endif
  pixel = pass == ${PASS.blend} ? vec4(color, 1.0) * opacity : vec4(color, 1.0);
}`;

export const DENSE_FRAGMENT = `#version 300 es
precision highp float;
uniform float gain;
uniform vec4 eye;
uniform float metallic;
uniform bool isWhole;
${KEPT}
${WRITE_GLSL}
in vec3 lit;
in vec3 shine;
void main() {
  if (isWhole) {
    pixel = vec4(lit, 1.0);
    return;
  }
  vec4 base = texture(image, texel, SHARPER);
  if (alphaMode != 0 && isHidden(shown.a * base.a)) discard;
  vec3 color = lit * base.rgb + shine * mix(vec3(1.0), base.rgb, metallic) + emission;
  write(encoded(color * gain), 1.0, faceNormal(normalize(eye.xyz - eye.w * place)));
}`;

export const FRAGMENT = `#version 300 es
precision highp float;
#ifdef MAPS
uniform sampler2D roughMetal;
uniform sampler2D glow;
#endif
#ifdef GLASS
uniform float ior;
uniform bool thin;
uniform mat4 toClip;
uniform sampler2D behind; // what is drawn before glass, multiplied by its alpha
uniform bool hasBehind;
uniform bool isBall; // of solid glass
uniform float depth; // how far behind glass is what is seen through it
#endif
#ifdef COAT
uniform float coat;
uniform float coatRoughness;
#endif
${LIGHT_GLSL}
${KEPT}
${WRITE_GLSL}
in vec3 facing;
#ifdef GLASS
// Direction behind glass: through a ball, in and out again.
vec3 refracted(vec3 n, vec3 v, out vec3 inside) {
  inside = -v;
  if (thin) return -v;
  inside = refract(-v, n, 1.0 / ior);
  vec3 way = refract(inside, 2.0 * dot(n, inside) * inside - n, ior);
  return dot(way, way) < 0.5 ? inside : way;
}
vec3 transmitted(vec3 n, vec3 v, float rough) {
  vec3 inside, from = place;
  vec3 way = refracted(n, v, inside);
  if (isBall) from -= depth * dot(n, inside) * inside;
  float spread = SPREAD_OF(way);
  vec3 light = seenAlong(from, way, rough, spread);
#ifdef RECTANGLES
  light += lampsAlong(from, way, rough, spread, vec4(1.0));
#endif
#ifdef MIRRORS
  if (isBall && showsScene) return light; // it shows what is behind upside down
#endif
  if (!hasBehind) return light;
  vec4 at = toClip * vec4(place + depth * way, 1.0);
  vec2 uv = 0.5 + 0.5 * at.xy / at.w;
  if (at.w <= 0.0 || uv != clamp(uv, 0.0, 1.0)) return light;
  vec4 known = textureLod(behind, uv, 7.0 * rough);
  return known.a > 0.01 ? mix(light, undisplayed(known.rgb / known.a), known.a) : light;
}
#endif
void main() {
  vec4 base = texture(image, texel, isForMirrors ? BLURRED : SHARPER);
  base = vec4(srgbDecode(shown.rgb) * base.rgb, shown.a * base.a);
  if (alphaMode != 0 && isHidden(base.a)) discard;
  vec3 v = normalize(eye.xyz - eye.w * place);
  vec3 flatly = faceNormal(v);
  vec3 n = dot(facing, facing) > 0.01 ? normalize(facing) : flatly;
  if (dot(n, flatly) < 0.0) {
    n = -n;
#ifdef SHADOWS
    if (pass == ${PASS.opaque} && !isBackSeen(gl_FragCoord.xy)) discard;
#endif
  }
  float rough = roughness;
  float metal = metallic;
  vec3 added = emission;
  vec3 missed = vec3(0.0);
  vec4 open = vec4(1.0);
#ifdef SHADOWS
  float slack = fwidth(gl_FragCoord.z);
  if (pass == ${PASS.opaque}) shadowsAt(gl_FragCoord.xy, gl_FragCoord.z, slack, edged(n, flatly), missed, open);
#endif
#ifdef MAPS
  vec3 packed = texture(roughMetal, texel).rgb;
  rough *= packed.g;
  metal *= packed.b;
  added *= texture(glow, texel).rgb;
#endif
  rough = clamp(rough, 0.0, 1.0);
  metal = clamp(metal, 0.0, 1.0);
  vec3 color = base.rgb;
  if (!unlit) {
    vec3 diffuse, glossy;
    float passed;
    shade(place, n, v, base.rgb, rough, metal, missed, open, diffuse, glossy, passed);
    vec3 body = base.rgb * diffuse;
#ifdef GLASS
    // What does not leave glass at once leaves it to all sides.
    vec3 through = thin ? transmitted(n, v, rough) : mix(irradiance[0] * 0.282095, transmitted(n, v, rough), passed);
    body = mix(body, base.rgb * through, transmission);
#endif
    color = passed * body + glossy;
#ifdef COAT
    if (coat > 0.0) {
      float weight = coat * (0.04 + 0.96 * pow(1.0 - clamp(dot(n, v), 0.0, 1.0), 5.0));
      color = mix(color, reflected(reflect(-v, n), coatRoughness), weight);
    }
#endif
  }
  if (isForMirrors) color = min(color, 1.0 / gain); // without shadows, some surfaces would be far too bright
  color = (color + added) * gain;
#ifdef CURVES
  write(isForMirrors ? encoded(color) : displayed(color, curve), base.a, flatly);
#else
  write(encoded(color), base.a, flatly);
#endif
}`;
