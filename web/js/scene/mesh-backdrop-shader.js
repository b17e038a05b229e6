/** The shaders of what is around a preview mesh: the studio's floor, and behind it the light around the scene. */

import { TONEMAP_GLSL } from "../film/tonemap.js";
import { AROUND_GLSL, LIGHT_GLSL, SHADOWS_GLSL } from "./mesh-light-shader.js";

/** The studio's floor around the scene, as far as its map reaches; what is behind the mesh has the colour of the rest. */
export const FLOOR_VERTEX = `#version 300 es
uniform mat4 toClip;
uniform vec3 corner;
uniform vec3 alongX;
uniform vec3 alongY;
out vec3 place;
void main() {
  place = corner + float(gl_VertexID & 1) * alongX + float(gl_VertexID >> 1) * alongY;
  gl_Position = toClip * vec4(place, 1.0);
}`;
export const FLOOR_FRAGMENT = `#version 300 es
precision highp float;
precision highp sampler2D;
uniform int curve;
#ifdef LAMPS
${LIGHT_GLSL}
#else
uniform float gain;
${SHADOWS_GLSL}
#endif
${TONEMAP_GLSL}
in vec3 place;
out vec4 pixel;
void main() {
  vec2 uv = 0.5 + vec2(dot(place, floorX), dot(place, floorY));
  vec4 lacking = lackingAt(uv, 0.0);
  float slack = fwidth(gl_FragCoord.z);
  vec3 missed = vec3(0.0);
  vec4 open = vec4(1.0);
#ifdef LAMPS
  bool isNear = true;
#else
  bool isNear = lacking.a < NARROW; // most of the floor has no shadow, or a wide one
#endif
  if (isNear) shadowsAt(gl_FragCoord.xy, gl_FragCoord.z, slack, floorPlane.xyz, missed, open);
  missed *= dot(floorRadiance, LUMINANCE);
  missed = mix(missed, lacking.rgb, smoothstep(0.0, NARROW, lacking.a));
  vec3 color = max(floorRadiance - missed, 0.0);
  float shown = 1.0;
#ifdef LAMPS
  vec3 diffuse = vec3(0.0), glossy = vec3(0.0);
  addLamps(place, floorPlane.xyz, normalize(eye.xyz - eye.w * place), 1.0, vec3(0.0), vec3(0.0), open, diffuse, glossy);
  color += floorAlbedo * diffuse;
  shown -= smoothstep(0.3, 0.5, length(uv - 0.5));
#endif
#ifdef CURVES
  pixel = vec4(displayed(color * gain, curve), 1.0) * shown;
#else
  pixel = vec4(srgbEncode(neutral(color * gain)), 1.0) * shown;
#endif
}`;

/** What is behind the mesh: the light around the scene, as seen by the camera. */
export const BACKDROP_VERTEX = `#version 300 es
out vec2 at;
void main() {
  at = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4.0 - 1.0;
  gl_Position = vec4(at, 0.9999999, 1.0);
}`;
export const BACKDROP_FRAGMENT = `#version 300 es
precision highp float;
uniform vec3 forward;
uniform vec3 across;
uniform vec3 upward;
uniform float gain;
uniform int curve;
uniform vec3 eye; // relative to the middle of the floor
uniform vec3 above; // normal of the floor
uniform float reach; // half the floor's side length; 0: the floor, if there is one, reaches the horizon
uniform bool isBelow; // the floor is seen from below; then the light around is without it
uniform vec3 lowerSide; // radiance of the floor's lower side
uniform vec3 beyond; // as LightTables has it
${AROUND_GLSL}
${TONEMAP_GLSL}
in vec2 at;
out vec4 pixel;
const float HALF_ROW = 0.0246; // of the table: sine of the elevation from which it shows nothing of the floor
const float HORIZON = 0.006; // half the width of the horizon, as a sine of elevation: that of the presets' texels
// What is seen along a direction. The table's texels are too wide for the floor's far end.
vec3 behind(vec3 way) {
  if (reach == 0.0) return reflected(way, 0.0);
  float fall = dot(way, above);
  vec3 along = max(abs(way - fall * above), 1e-6);
  vec3 exits = (reach - sign(way) * eye) / along + 1e9 * abs(above); // distance to the floor's sides
  float left = dot(eye, above) + fall * min(exits.x, min(exits.y, exits.z)); // height above the floor's edge
  float onFloor = clamp(0.5 - (isBelow ? -left : left) / max(fwidth(left), 1e-9), 0.0, 1.0);
  if (isBelow) return mix(reflected(way, 0.0), lowerSide, onFloor);
  vec3 color = reflected(normalize(way + max(HALF_ROW - fall, 0.0) * above), 0.0) * mix(beyond, vec3(1.0), smoothstep(-HORIZON, HORIZON, fall));
  return mix(color, reflected(-above, 0.0), onFloor);
}
void main() {
  vec3 color = behind(normalize(forward + at.x * across + at.y * upward)) * gain;
#ifdef CURVES
  pixel = vec4(displayed(color, curve), 1.0);
#else
  pixel = vec4(srgbEncode(neutral(color)), 1.0);
#endif
}`;
