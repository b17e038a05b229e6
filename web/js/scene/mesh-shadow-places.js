/** Projections of a preview mesh's shadow maps, from directions and lamps, the place of the floor's map, and bounds of the scene. */

import { FLOOR_TEXELS } from "./mesh-floor-shader.js";
import { MOST_LAMP_TILES } from "./mesh-shadow-shader.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").Lamp} Lamp */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */
/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */
/** @typedef {import("../news/mesh-packet.js").MeshPart} MeshPart */
/** @typedef {import("./mesh-shadow.js").Subject} Subject */

/** Half the side length of the floor's map, in radii of the scene. */
const REACH = 3.5;
/** How far from the middle of the scene the map's corners are, in radii. */
export const FLOOR_REACH = 1 + REACH * Math.SQRT2;

/** Half the side length of the studio's floor, in diagonals of the scene's bounds (renderer/scene/studio.py). */
const FLOOR_DIAGONALS = 30;

/** @param {MeshPacket} mesh @returns {Vec3} */
export const extentOf = ({ low, high }) => /** @type {Vec3} */ (high.map((value, i) => value - (low[i] ?? 0)));

/** Returns the radius of the sphere around the scene's bounds. @param {MeshPacket} mesh */
export const radiusOf = (mesh) => (Math.hypot(...extentOf(mesh)) / 2 || 1) * 1.001;

/** Returns half the side length of the studio's floor. @param {MeshPacket} mesh */
export const floorReach = (mesh) => 2 * FLOOR_DIAGONALS * radiusOf(mesh);

/** @param {Vec3} a @param {Vec3} b @returns {Vec3} */
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
/** @param {number[]} a @param {number[]} b */
const dot = (a, b) => a.reduce((sum, value, i) => sum + value * (b[i] ?? 0), 0);
/** @param {number[]} vector @returns {Vec3} */
const unit = (vector) => /** @type {Vec3} */ (vector.map((value) => value / (Math.hypot(...vector) || 1)));

/** Returns two unit vectors across a direction. @param {Vec3} way @param {number} turn in radians @returns {[Vec3, Vec3]} */
function acrossOf(way, turn) {
  const a = unit(cross(Math.abs(way[1]) < 0.9 ? [0, 1, 0] : [1, 0, 0], way));
  const b = cross(way, a);
  const [cosine, sine] = [Math.cos(turn), Math.sin(turn)];
  return [/** @type {Vec3} */ (a.map((value, i) => cosine * value + sine * (b[i] ?? 0))), /** @type {Vec3} */ (b.map((value, i) => cosine * value - sine * (a[i] ?? 0)))];
}

/** Golden angle: tiles are turned by it, so that the errors of their texels average out. */
const TURN = 2.399963;

/** Returns the rows of the projection along a direction onto the sphere around the scene. @param {Vec3} way towards the light @param {number} i @param {number} radius */
export function rowsTowards(way, i, radius) {
  const [u, v] = acrossOf(way, i * TURN);
  return [u, v, way.map((value) => -value)].flatMap((axis) => [...axis.map((value) => value / radius), 0]);
}

/** Returns the matrix of three rows, column by column. @param {number[]} rows */
export const matrixOf = (rows) => Float32Array.from({ length: 16 }, (_, at) => (at % 4 < 3 ? (rows[4 * (at % 4) + (at >> 2)] ?? 0) : at === 15 ? 1 : 0));

/** Returns the bounds of a part, relative to the mesh's middle, with some room. @param {MeshPacket} mesh @param {MeshPart} part */
export function boxOf(mesh, { first, corners }) {
  const room = ROOM * radiusOf(mesh);
  const extent = extentOf(mesh);
  const [low, high] = [[Infinity, Infinity, Infinity], [-Infinity, -Infinity, -Infinity]];
  for (let i = first; i < first + corners; i++)
    for (let axis = 0; axis < 3; axis++) {
      const value = ((mesh.positions[4 * (mesh.indices[i] ?? 0) + axis] ?? 0) / 65535 - 0.5) * (extent[axis] ?? 0);
      low[axis] = Math.min(low[axis] ?? 0, value - room);
      high[axis] = Math.max(high[axis] ?? 0, value + room);
    }
  return { low, high };
}

/** Room around a part that shines, in radii of the scene. */
const ROOM = 0.01;

/** Side length of the views of the scene's albedo, in radii. */
const ALBEDO_SIDE = 2.1;
/** Width of a texel of these views, in texels of the floor's map, which has twice as many along a side. */
export const VIEW_TEXEL = ALBEDO_SIDE / REACH;
/** Height between the depths 0 and 1 of these views, in texels of the floor's map. */
export const VIEW_DEPTH = FLOOR_TEXELS / REACH;

/** Returns the axes of the views of a scene's albedo, which turn places into shares of a view. @param {Subject} subject @returns {[Vec3, Vec3]} */
export function albedoAxes(subject) {
  const { floorX, floorY } = floorMap(subject);
  const side = ALBEDO_SIDE * radiusOf(subject.mesh);
  const scaled = (/** @type {Vec3} */ axis) => /** @type {Vec3} */ (unit(axis).map((value) => value / side));
  return [scaled(floorX), scaled(floorY)];
}

/** Returns the map of the floor below a scene. @param {Pick<Subject, "mesh" | "above">} subject */
export function floorMap({ mesh, above }) {
  const up = above ?? [0, 1, 0];
  const sizes = up.map(Math.abs);
  const axis = sizes.indexOf(Math.max(...sizes));
  const sign = Math.sign(up[axis] ?? 1);
  const extent = extentOf(mesh);
  const side = 2 * REACH * radiusOf(mesh);
  /** @param {number} i @param {number} value @returns {Vec3} */
  const onAxis = (i, value) => /** @type {Vec3} */ ([0, 1, 2].map((each) => (each === i % 3 ? value : 0)));
  const height = -(extent[axis] ?? 0) / 2;
  const [alongX, alongY] = [onAxis(axis + 1, side), onAxis(axis + 2, sign * side)]; // their cross product is upward
  const corner = onAxis(axis, sign * height).map((value, i) => value - ((alongX[i] ?? 0) + (alongY[i] ?? 0)) / 2);
  return { corner, alongX, alongY, above: onAxis(axis, sign), height, floorX: onAxis(axis + 1, 1 / side), floorY: onAxis(axis + 2, sign / side) };
}

/** Distance of a lamp, in radii of the scene, from which one tile shows the whole scene. */
const OUTSIDE = 1.15;
/** Nearest and farthest that a tile of a lamp among the scene shows, in radii. */
const [NEAREST, FARTHEST] = [0.004, 8];

/** Returns a lamp's place relative to the mesh's middle, with 1, or its direction, with 0. @param {MeshPacket} mesh @param {Lamp} lamp @returns {number[]} */
export function placeOf({ low, high }, { at, far }) {
  return far ? [...unit(at), 0] : [...at.map((value, i) => value - ((low[i] ?? 0) + (high[i] ?? 0)) / 2), 1];
}

/** Returns the tiles that show what each lamp sees. @param {MeshPacket} mesh @param {Lamp[]} lamps @returns {{lamp: number, matrix: number[], texel: number}[]} texel: width of a tile, at distance 1 or of parallel light anywhere */
export function lampTilesOf(mesh, lamps) {
  const radius = radiusOf(mesh);
  return lamps
    .flatMap((lamp, number) => {
      const place = /** @type {Vec3} */ (placeOf(mesh, lamp).slice(0, 3));
      if (lamp.far) return [{ lamp: number, matrix: [...matrixOf(rowsTowards(place, number, radius))], texel: 2 * radius }];
      const away = Math.hypot(...place);
      if (away > OUTSIDE * radius) {
        const slope = Math.tan(Math.asin(radius / away));
        return [{ lamp: number, matrix: perspective(place, unit(place.map((value) => -value)), slope, away - radius, away + radius), texel: 2 * slope }];
      }
      return [0, 1, 2].flatMap((axis) =>
        [1, -1].flatMap((sign) => {
          const forward = /** @type {Vec3} */ ([0, 1, 2].map((i) => (i === axis ? sign : 0)));
          if (dot(lamp.axis, lamp.axis) > 0 && dot(lamp.axis, forward) < -0.99) return []; // a lamp that shines to one side
          return [{ lamp: number, matrix: perspective(place, forward, 1, NEAREST * radius, FARTHEST * radius), texel: 2 }];
        }),
      );
    })
    .slice(0, MOST_LAMP_TILES);
}

/** Returns the matrix of a camera, column by column. @param {Vec3} from @param {Vec3} forward unit vector @param {number} slope tangent of half its field of view @param {number} near @param {number} far */
function perspective(from, forward, slope, near, far) {
  const [u, v] = acrossOf(forward, 0);
  const rows = [
    [...u.map((value) => value / slope), -dot(u, from) / slope],
    [...v.map((value) => value / slope), -dot(v, from) / slope],
    [...forward.map((value) => (value * (far + near)) / (far - near)), (-dot(forward, from) * (far + near)) / (far - near) - (2 * far * near) / (far - near)],
    [...forward, -dot(forward, from)],
  ];
  return Array.from({ length: 16 }, (_, at) => rows[at % 4]?.[at >> 2] ?? 0);
}
