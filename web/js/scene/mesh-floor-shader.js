/** The map of the floor below a preview mesh for its shaders: the light that the floor lacks where it is shadowed. */

/** Side length of the floor's map in texels. */
export const FLOOR_TEXELS = 128;

/** Functions that look up the floor's map, at a point or where a ray hits the floor. */
export const FLOOR_MAP_GLSL = `
uniform sampler2D floorMissed; // as GIVEN_FRAGMENT writes it
uniform vec4 floorPlane; // upward, and the floor's height; 0: there is no floor
uniform vec3 floorX; // from the point below the middle, to coordinates of the map
uniform vec3 floorY;
uniform float floorAlbedo;
uniform vec3 floorRadiance; // where nothing is in the light's way
const float FLOOR_TEXELS = ${FLOOR_TEXELS}.0;
const vec2 FAINT = vec2(0.0, 0.01); // part of the light below which a shadow is that of a single direction, far from what casts it
const float NARROW = 2.0; // width in texels up to which shadows are sharper than the map
const vec3 LUMINANCE = vec3(0.2126, 0.7152, 0.0722);
// Radiance that the floor lacks at a point of its map, and the width of its shadow.
vec4 lackingAt(vec2 uv, float level) {
  vec2 edge = 1.0 - smoothstep(0.3, 0.5, abs(uv - 0.5));
  vec4 missed = textureLod(floorMissed, uv, floor(8.0 * level + 0.5) / 8.0); // levels that differ within a group of pixels are slow in software
  return vec4(edge.x * edge.y * smoothstep(FAINT.x, FAINT.y, abs(dot(missed.rgb, LUMINANCE))) * missed.rgb * dot(floorRadiance, LUMINANCE), missed.a);
}
// Radiance that the floor lacks along a ray that goes downward, spread by roughness.
vec3 missedFrom(vec3 place, vec3 way, float spread) {
  float fall = -dot(way, floorPlane.xyz);
  if (fall < 1e-3) return vec3(0.0);
  float far = max(dot(place, floorPlane.xyz) - floorPlane.w, 0.0) / fall;
  vec3 hit = place + far * way;
  vec2 uv = 0.5 + vec2(dot(hit, floorX), dot(hit, floorY));
  return lackingAt(uv, log2(1.0 + spread * far * length(floorX) * FLOOR_TEXELS)).rgb;
}`;
