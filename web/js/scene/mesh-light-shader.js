/** How surfaces of a preview mesh look in the light around them and of lamps, with their shadows: the functions that the shaders of the mesh and of its surroundings share. */

import { FLOOR_MAP_GLSL } from "./mesh-floor-shader.js";
import { LEVELS } from "./mesh-environment.js";
import { FAR, MOST_BALLS, NEAR, SIDE } from "./mesh-mirror.js";

/** Lamps that the mesh is shaded by; what the others give comes from all around. */
export const MOST_LAMPS = 4;
/** Weaker lamps inside emissive parts, by which the mesh is shaded too, without shadows. */
export const MOST_GLOWS = 4;
const SHADING_LAMPS = MOST_LAMPS + MOST_GLOWS;

/** Radiance around the scene, blurred by roughness, and irradiance by the normal. */
export const AROUND_GLSL = `
uniform sampler2D around;
uniform vec3 irradiance[9]; // by spherical harmonics, divided by pi
vec3 reflected(vec3 way, float roughness) {
  vec2 at = vec2(0.5 + atan(way.x, -way.z) / 6.2831853, acos(clamp(way.y, -1.0, 1.0)) / 3.1415927);
  return textureLod(around, at, roughness * ${LEVELS}.0).rgb;
}
vec3 received(vec3 n) {
  return max(irradiance[0] * 0.282095
    + 0.488603 * (irradiance[1] * n.y + irradiance[2] * n.z + irradiance[3] * n.x)
    + 1.092548 * (irradiance[4] * n.x * n.y + irradiance[5] * n.y * n.z + irradiance[7] * n.x * n.z)
    + irradiance[6] * 0.315392 * (3.0 * n.z * n.z - 1.0)
    + irradiance[8] * 0.546274 * (n.x * n.x - n.y * n.y), 0.0);
}`;

/** Normals for shadows: smoothed ones, unless they are those of a box whose edges are not sharp, rather than of a round surface. */
export const EDGED_GLSL = `
float bentOf(vec3 smoothed, vec3 flatly) {
  return 1.0 - smoothstep(0.6, 0.94, dot(smoothed, flatly));
}
vec3 edged(vec3 smoothed, vec3 flatly) {
  return normalize(mix(smoothed, flatly, bentOf(smoothed, flatly)));
}`;

/** Shadows at what the camera sees. */
export const SHADOWS_GLSL = `
${FLOOR_MAP_GLSL}
uniform sampler2D missedLight; // light from around that does not reach what the camera sees, in proportion to the luminance of all
uniform sampler2D openLamps; // parts of the lamps' light that reach it
uniform sampler2D seenDepth;
uniform sampler2D seenNormal;
uniform vec2 perPixel;
${EDGED_GLSL}
const int FEWEST_BACK = 4; // of nine texels: of a line of them along an edge there are three
// Whether back faces are seen around a pixel of the canvas. Else the depth of one that folds back there is imprecise: the face in front hides it.
bool isBackSeen(vec2 pixel) {
  ivec2 size = textureSize(seenDepth, 0), middle = ivec2(pixel * perPixel * vec2(size));
  int seen = 0;
  for (int i = 0; i < 9; i++) seen += int(texelFetch(seenNormal, clamp(middle + ivec2(i % 3, i / 3) - 1, ivec2(0), size - 1), 0).a < 0.5);
  return seen >= FEWEST_BACK;
}
// Light at a pixel of the canvas: that of the texels around it which show the same surface. n: as edged
void shadowsAt(vec2 pixel, float depth, float slack, vec3 n, out vec3 missed, out vec4 open) {
  ivec2 size = textureSize(seenDepth, 0);
  vec2 at = pixel * perPixel * vec2(size) - 0.5;
  ivec2 first = ivec2(floor(at + 1e-3));
  vec2 share = at - vec2(first);
  slack += 0.01 * (1.0 - depth) + 1e-4;
  missed = vec3(0.0);
  open = vec4(0.0);
  float total = 0.0;
  for (int i = 0; i < 4 || (i < 16 && total < 0.1); i++) { // the four around it, and if they show other surfaces, those around them
    ivec2 side = i < 4 ? ivec2(i & 1, i >> 1) : ivec2(i & 3, i >> 2) - 1;
    ivec2 texel = clamp(first + side, ivec2(0), size - 1);
    vec2 near = i < 4 ? mix(1.0 - share, share, vec2(side)) : vec2(0.3);
    if (near.x * near.y < 1e-3) continue;
    float gap = abs(texelFetch(seenDepth, texel, 0).r - depth);
    float alike = gap < slack ? smoothstep(0.3, 0.9, dot(n, 2.0 * texelFetch(seenNormal, texel, 0).rgb - 1.0)) : 0.0;
    float weight = near.x * near.y * (alike + 1e-4 / (1.0 + 1e3 * gap));
    missed += weight * texelFetch(missedLight, texel, 0).rgb;
    open += weight * texelFetch(openLamps, texel, 0);
    total += weight;
  }
  missed /= total;
  open /= total;
}`;

/** How a surface looks in the light around it and of the lamps. */
export const LIGHT_GLSL = `
uniform vec4 eye; // its place, with 1, or of an orthographic camera the direction to it, with 0
uniform vec3 extent;
#ifdef LAMPS
uniform int lampCount;
uniform vec4 lamps[${SHADING_LAMPS}]; // places, with 1, or directions, with 0
uniform vec3 lampColors[${SHADING_LAMPS}]; // radiance of a white surface at the middle
uniform vec3 lampAxes[${SHADING_LAMPS}];
uniform vec2 lampCosines[${SHADING_LAMPS}];
#ifdef RECTANGLES
uniform vec3 lampHalves[${2 * SHADING_LAMPS}]; // of rectangles, from the middle to those of two sides; 0: the lamp is none
uniform vec3 lampRadiances[${SHADING_LAMPS}]; // of rectangles
#endif
float openOf(int lamp, vec4 open) {
  return lamp < ${MOST_LAMPS} ? open[min(lamp, ${MOST_LAMPS - 1})] : 1.0;
}
#endif
uniform float metallic;
uniform float roughness;
uniform vec3 f0;
${AROUND_GLSL}
vec3 srgbDecode(vec3 c) {
  return mix(c / 12.92, pow((c + 0.055) / 1.055, vec3(2.4)), greaterThan(c, vec3(0.04045)));
}
uniform float gain; // 2^exposure
// Inverts what the default curve does to values that it does not compress.
vec3 undisplayed(vec3 c) {
  c = srgbDecode(c);
  float least = min(c.r, min(c.g, c.b));
  return (c + (least < 0.04 ? sqrt(least / 6.25) - least : 0.04)) / gain;
}
#ifdef MIRRORS
uniform samplerCube mirrored; // the scene from a point, without what reflects it: radiance times gain, multiplied by its alpha
uniform highp samplerCube mirroredDepth;
uniform vec3 mirroredFrom;
uniform bool showsScene;
uniform bool isBlack; // nothing is around the scene
#ifdef FOLLOWED
const int STEPS = 7, HALVINGS = 3; // along a ray, and of the step in which something is met
const vec2 THICK = vec2(0.3, 0.5); // a point is hidden if the surface seen towards it is nearer than this part of its distance
// Ranges of roughness, and of the distance of the surface that a ray meets, in proportion to that of the ray's origin from the cube's middle, over which
// the cube is looked up where the ray leaves the bounds instead: parallax is small there, and rough surfaces would show sharp edges where rays begin to
// meet a surface.
const vec2 ROUGH = vec2(0.05, 0.2), FAR_AWAY = vec2(0.75, 1.5);
// Distance of the surface that the cube shows towards a point, in proportion to the point's own.
float seenBehind(vec3 way) {
  vec3 sizes = abs(way);
  float depth = 2.0 * textureLod(mirroredDepth, way, 0.0).r - 1.0;
  float radius = 0.5 * length(extent);
  return 2.0 * radius * ${FAR * NEAR} / (${FAR + NEAR} - depth * ${FAR - NEAR}) / max(sizes.x, max(sizes.y, sizes.z));
}
#endif
// Place where a ray leaves the bounds, or before that meets the scene, relative to the cube's middle: the first one behind the surface that the cube
// shows towards it. w: 0 if the cube does not show that place, for which something hides it.
// Source: Szirmay-Kalos et al. 2005, "Approximate ray-tracing on the GPU with distance impostors".
vec4 metAlong(vec3 place, vec3 way, float rough) {
  vec3 safe = mix(way, vec3(1e-6), lessThan(abs(way), vec3(1e-6)));
  vec3 ends = (0.5 * extent * sign(safe) - place) / safe;
  float end = max(min(ends.x, min(ends.y, ends.z)), 0.0);
  place -= mirroredFrom;
#ifndef FOLLOWED
  return vec4(place + end * way, 1.0);
#else
  float before = 0.0, after = end, depth = 1.0;
  bool wasOpen = false, isFound = false;
  int step = 1, halved = 0;
  for (int i = 0; i < STEPS + HALVINGS + 2; i++) { // one loop: a processor that stands in for a graphics card compiles each look-up anew
    float at = isFound ? 0.5 * (before + after) : end * float(step * step) / float(STEPS * STEPS);
    float seen = seenBehind(place + at * way);
    if (!isFound && step == STEPS) {
      after = end;
      depth = seen;
      break;
    }
    bool isOpen = seen > 1.0;
    if (isOpen) before = at;
    else if (isFound || wasOpen) {
      after = at;
      depth = seen;
      isFound = true;
    }
    wasOpen = isOpen;
    step++;
    if (!isFound || halved++ < HALVINGS) continue;
    if (depth >= THICK.y) break;
    isFound = false; // it passes behind something
    step = STEPS;
  }
  float away = depth * length(place + after * way);
  float isBeyond = smoothstep(ROUGH.x, ROUGH.y, rough) * smoothstep(FAR_AWAY.x, FAR_AWAY.y, away / max(length(place), 1e-6));
  return vec4(place + mix(after, end, isBeyond) * way, mix(smoothstep(THICK.x, THICK.y, depth), 1.0, isBeyond));
#endif
}
#ifdef BALLS
uniform samplerCube mirroredBalls; // the balls alone, encoded as mirrored
uniform int ballCount;
uniform vec4 balls[${MOST_BALLS}]; // middles and radii, of mirrors negative ones
const float BEYOND = 0.04; // how far within its outline a ball is looked up, in radii: what is beyond it is not seen from the cube's middle
// Direction in which the cube shows the nearest ball that a ray meets: a matte one where it is met, and a mirror, which looks about the same from
// everywhere, at the same place of its outline. w: its part of the rays within an angle.
vec4 ballAlong(vec3 place, vec3 way, float spread) {
  float nearest = 1e30, part = 0.0;
  vec3 met = vec3(0.0);
  vec4 ball = vec4(1.0);
  for (int i = 0; i < ballCount; i++) {
    vec3 from = place - balls[i].xyz;
    float along = -dot(from, way), radius = abs(balls[i].w);
    if (along <= 0.0) continue;
    float away = length(from + along * way);
    float at = along - sqrt(max(radius * radius - away * away, 0.0));
    float share = 1.0 - smoothstep(-along * spread, along * spread, away - radius);
    if (share == 0.0 || at >= nearest) continue;
    nearest = at;
    part = share;
    met = from + (balls[i].w < 0.0 ? along : at) * way;
    ball = balls[i];
  }
  vec3 towards = ball.xyz - mirroredFrom;
  float far = max(length(towards), 1e-6), radius = abs(ball.w);
  towards /= far;
  if (ball.w < 0.0) {
    vec3 side = met - dot(met, towards) / max(1.0 + dot(way, towards), 0.1) * (way + towards); // turned as the directions are
    float sine = min(length(met) / radius, 1.0 - BEYOND) * min(radius / far, 1.0);
    return vec4(sqrt(1.0 - sine * sine) * towards + sine * normalize(side + 1e-6), part);
  }
  vec3 n = normalize(met);
  float least = min(radius / far + BEYOND, 0.99), facing = -dot(n, towards);
  if (facing < least) n = sqrt(1.0 - least * least) * normalize(n + facing * towards + 1e-6) - least * towards;
  return vec4(far * towards + radius * n, part);
}
#endif
#endif
const float LOBE = 4.5; // half the width of a rough reflection, by the square of the roughness
// Radiance along a ray: of the scene, if it is seen there, or else of its surroundings. spread: angle between the rays of neighbouring pixels.
vec3 seenAlong(vec3 place, vec3 way, float rough, float spread) {
  vec3 light = reflected(way, rough);
#ifdef MIRRORS
  if (showsScene) {
    float wide = max(spread, LOBE * rough * rough);
    float level = clamp(log2(max(${SIDE / 2}.0 * wide, 1e-3)), 0.0, 6.0);
    vec4 met = metAlong(place, way, rough);
    vec4 known = met.w * textureLod(mirrored, met.xyz, level);
    if (isBlack) light = vec3(0.0);
    if (known.a > 1e-3) light = mix(light, known.rgb / known.a / gain, known.a);
#ifdef BALLS
    vec4 ball = ballAlong(place, way, wide);
    if (ball.w > 0.0) {
      vec4 shown = textureLod(mirroredBalls, ball.xyz, level);
      if (shown.a > 0.01) light = mix(light, shown.rgb / shown.a / gain, ball.w);
    }
#endif
  }
#endif
  return light;
}
#ifdef AT_VERTICES
#define SPREAD_OF(way) 0.05
#else
#define SPREAD_OF(way) min(0.5 * length(fwidth(way)), 0.3)
#endif
// Specular albedo of a rough surface in even light. Source: Karis 2014, "Physically based shading on mobile".
vec2 environmentBrdf(float nv, float rough) {
  vec4 r = rough * vec4(-1.0, -0.0275, -0.572, 0.022) + vec4(1.0, 0.0425, 1.04, -0.04);
  float a = min(r.x * r.x, exp2(-9.28 * nv)) * r.x + r.y;
  return vec2(-1.04, 1.04) * a + r.zw;
}
#ifdef RECTANGLES
// Radiance of the lamps that are rectangles along a ray. open: as shadowsAt.
vec3 lampsAlong(vec3 place, vec3 way, float rough, float spread, vec4 open) {
  vec3 light = vec3(0.0);
  for (int i = 0; i < lampCount; i++) {
    vec3 u = lampHalves[2 * i], v = lampHalves[2 * i + 1], to = lamps[i].xyz - place;
    vec3 across = cross(u, v);
    float far = dot(to, across) / dot(way, across);
    if (!(far > 0.0) || dot(way, lampAxes[i]) > 0.0) continue; // it is no rectangle, or behind, or shines to the other side
    vec3 at = far * way - to;
    vec2 share = vec2(dot(at, u), dot(at, v)) / vec2(dot(u, u), dot(v, v));
    vec2 wide = far * max(spread, LOBE * rough * rough) / vec2(length(u), length(v));
    vec2 covered = smoothstep(-wide, wide, 1.0 - share) - smoothstep(-wide, wide, -1.0 - share);
    light += covered.x * covered.y * openOf(i, open) * lampRadiances[i];
  }
  return light;
}
#endif
#ifdef LAMPS
// Light of the lamps: diffuse, and what a rough surface reflects of it (GGX, Walter et al. 2007).
void addLamps(vec3 place, vec3 n, vec3 v, float rough, vec3 reflectance, vec3 again, vec4 open, inout vec3 diffuse, inout vec3 glossy) {
  float alpha2 = max(rough * rough, 0.01);
  alpha2 *= alpha2;
  for (int i = 0; i < lampCount; i++) {
    vec3 way = lamps[i].xyz - lamps[i].w * place;
    float far = dot(lamps[i].xyz, lamps[i].xyz);
    float near = lamps[i].w > 0.5 ? min(far / max(dot(way, way), 1e-12), i < ${MOST_LAMPS} ? 6.0 : 20.0) : 1.0;
    vec3 l = normalize(way);
    float cone = clamp((-dot(l, lampAxes[i]) - lampCosines[i].x) / (lampCosines[i].y - lampCosines[i].x), 0.0, 1.0);
    float nl = max(dot(n, l), 0.0);
    vec3 light = lampColors[i] * near * cone * nl * openOf(i, open);
    diffuse += light;
    if (i >= ${MOST_LAMPS}) continue; // a surface that shines is wider than the highlight of a point
#ifdef RECTANGLES
    if (lampHalves[2 * i] != vec3(0.0)) continue; // lampsAlong adds what a surface reflects of it
#endif
    vec3 h = normalize(l + v);
    float nh = max(dot(n, h), 0.0);
    float nv = max(dot(n, v), 1e-3);
    float d = nh * nh * (alpha2 - 1.0) + 1.0;
    float visibility = 0.5 / mix(2.0 * nl * nv, nl + nv, sqrt(alpha2) + 1e-3);
    vec3 fresnel = reflectance + (min(25.0 * reflectance, 1.0) - reflectance) * pow(1.0 - max(dot(l, h), 0.0), 5.0);
    glossy += light * again * fresnel * alpha2 / (d * d) * visibility; // times pi, and over it
  }
}
#endif
#ifdef SHADOWS
${SHADOWS_GLSL}
#endif
#ifdef GLASS
uniform float transmission;
#else
const float transmission = 0.0;
#endif
const float LEAST_REFLECTED = 0.6; // part of the light that a mirror shows where the floor is in shadow
// missed, open: as shadowsAt. diffuse: irradiance by pi. glossy: radiance. passed: part of the light that the surface does not reflect at once.
void shade(vec3 place, vec3 n, vec3 v, vec3 color, float rough, float metal, vec3 missed, vec4 open, out vec3 diffuse, out vec3 glossy, out float passed) {
  float nv = clamp(dot(n, v), 1e-3, 1.0);
  vec3 reflectance = mix(f0, color, metal);
  vec2 brdf = environmentBrdf(nv, rough);
  vec3 mirror = reflect(-v, n);
  float spread = SPREAD_OF(mirror);
  // Light scattered several times between microfacets. Source: Turquin 2019, "Practical multiple scattering compensation".
  vec3 again = 1.0 + reflectance * (1.0 / max(brdf.x + brdf.y, 0.05) - 1.0);
  vec3 albedo = again * (reflectance * brdf.x + min(25.0 * reflectance, 1.0) * brdf.y);
  vec3 whole = received(n);
  diffuse = max(whole - missed * dot(whole, vec3(0.2126, 0.7152, 0.0722)), 0.0);
  glossy = vec3(0.0);
  if (max(albedo.r, max(albedo.g, albedo.b)) > 0.0) {
    // The cube shows a surface of little reflectance itself.
    vec3 light = transmission > 0.0 || max(reflectance.r, max(reflectance.g, reflectance.b)) > 0.15 ? seenAlong(place, mirror, rough, spread) : reflected(mirror, rough);
#ifdef SHADOWS
    // The floor's map lacks what hides the floor, such as a thick plate below a metal: without a bound, its lower half would be black.
    if (max(reflectance.r, max(reflectance.g, reflectance.b)) > 0.1 && dot(mirror, floorPlane.xyz) < 0.0) light = max(light - missedFrom(place, mirror, rough) * smoothstep(0.0, 0.2, -dot(mirror, floorPlane.xyz)), LEAST_REFLECTED * light);
#endif
    glossy = light * albedo * mix(vec3(1.0), diffuse / max(whole, 1e-6), rough);
#ifdef RECTANGLES
    glossy += albedo * lampsAlong(place, mirror, rough, spread, open);
#endif
  }
#ifdef LAMPS
  addLamps(place, n, v, rough, reflectance, again, open, diffuse, glossy);
#endif
  passed = (1.0 - metal) * (1.0 - max(albedo.r, max(albedo.g, albedo.b)));
}`;
