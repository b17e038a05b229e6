/** What the shaders of a preview mesh read of the floor below it: the light that its shadows take from it. */

/** Side length of the floor's map in texels. */
export const FLOOR_TEXELS = 384;

/** Where on the floor's map a ray from a point ends, and what it finds. */
export const FLOOR_MAP_GLSL = `
uniform sampler2D floorMissed; // light that the floor misses, as irradiance by pi
uniform vec4 floorPlane; // upward, and the floor's height; 0: there is no floor
uniform vec3 floorX; // from the point below the middle, to coordinates of the map
uniform vec3 floorY;
uniform float floorAlbedo;
uniform vec3 floorRadiance; // where nothing is in the light's way
const float FLOOR_TEXELS = ${FLOOR_TEXELS}.0;
uniform vec3 floorBounds; // half the scene's extent
uniform float floorSpread; // angle between neighbouring directions of the light so far, in proportion to that of all
const float BLUR = 0.3; // angle between neighbouring ones of all directions, about
// Shadows farther from the scene are of something higher: those of all directions blend there.
vec3 floorShadow(vec3 place) {
  vec2 uv = 0.5 + vec2(dot(place, floorX), dot(place, floorY));
  vec2 edge = 1.0 - smoothstep(0.3, 0.5, abs(uv - 0.5));
  vec3 beside = max(abs(place) - floorBounds, 0.0) * (1.0 - abs(floorPlane.xyz));
  float level = log2(floorSpread * (1.0 + BLUR * length(beside) * length(floorX) * FLOOR_TEXELS));
  return edge.x * edge.y * textureLod(floorMissed, uv, level).rgb;
}
// What of the light reflected by the floor is missing along a ray that goes downward, spread by roughness.
vec3 missedFrom(vec3 place, vec3 way, float spread) {
  float fall = -dot(way, floorPlane.xyz);
  if (fall < 1e-3) return vec3(0.0);
  float far = max(dot(place, floorPlane.xyz) - floorPlane.w, 0.0) / fall;
  vec3 hit = place + far * way;
  vec2 uv = 0.5 + vec2(dot(hit, floorX), dot(hit, floorY));
  vec2 edge = 1.0 - smoothstep(0.3, 0.5, abs(uv - 0.5));
  float level = log2(1.0 + spread * far * length(floorX) * FLOOR_TEXELS);
  return floorAlbedo * edge.x * edge.y * textureLod(floorMissed, uv, level).rgb;
}`;
