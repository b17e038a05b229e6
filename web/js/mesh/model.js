/** Makes a preview of the shapes of a file: decimates them, computes missing normals, turns them upright, and frames them. */

import { MOST_TRIANGLES, decimated, encoded, frame, joined } from "./shapes.js";
import { roomView } from "./room.js";
import { smoothed } from "./smooth.js";
import { framedPlaces } from "./standing.js";
import { MATT, NO_TEXTURE, Pictures } from "./surface.js";
import { uprightMatrix } from "./up-axis.js";

/** @typedef {import("./shapes.js").LocalMesh} LocalMesh */
/** @typedef {import("./shapes.js").Picture} Picture */
/** @typedef {import("./shapes.js").Shape} Shape */
/** @typedef {import("./shapes.js").Vec3} Vec3 */
/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */

/** A shape with its colour (sRGB, and opacity), its image, and further values of its material. @typedef {{shape: Shape, color: number[], image: Picture | null, surface?: Partial<MeshMaterial>}} Part */

/** sRGB of linear 0.8 (renderer/scene/material.py), and of white. */
export const GREY = [231, 231, 231, 255];
export const WHITE = [255, 255, 255, 255];

/** Returns linear values as sRGB, 0 to 255. @param {number[]} linear */
export const coded = (linear) => linear.map((value) => Math.round(255 * encoded(Math.min(Math.max(value, 0), 1))));

/**
 * @param {Part[]} parts
 * @param {"y" | "z" | "-y" | number[]} up the format's conventional up axis, or the matrix by which the file becomes Y up
 * @param {boolean} isWhole whether the service would show the same materials
 * @param {number} [most] triangles, about
 * @param {{lamps?: import("./shapes.js").Lamp[], camera?: (low: Vec3, high: Vec3) => import("../base/types.js").View | null}} [own] the file's own lamps, which shine in a black world, and camera
 * @returns {LocalMesh | null} null if there are no triangles, or a position or an index is invalid
 */
export function modelOf(parts, up, isWhole, most = MOST_TRIANGLES, { lamps = [], camera } = {}) {
  const shown = parts.filter(({ shape }) => shape.indices.length > 0);
  const total = shown.reduce((sum, { shape }) => sum + shape.indices.length / 3, 0);
  if (!total || !shown.every(({ shape }) => isBelow(shape.indices, shape.positions.length / 3))) return null;
  const matrix = Array.isArray(up) ? up : uprightMatrix(shown.map(({ shape }) => shape), up);
  const pictures = new Pictures();
  const shapes = smoothed(shown.map(({ shape }) => decimated(shape, Math.min(1, most / total))));
  const drawn = shown.map(({ color, image, surface }, i) => {
    const shape = /** @type {Shape} */ (shapes[i]);
    return { shape, matrix, color, material: { ...MATT, ...surface, texture: shape.uvs ? pictures.numberOf(image) : NO_TEXTURE } };
  });
  const found = viewed(drawn, lamps, camera);
  return found && { packet: found.packet, view: found.view, isWhole: isWhole && found.hasAllMaterials, images: pictures.all };
}

/**
 * Joins shapes, and chooses their view: that of the file's camera, the one inside a room, or one that frames them.
 *
 * @param {import("./shapes.js").Drawn[]} drawn
 * @param {import("./shapes.js").Lamp[]} lamps of the file
 * @param {(low: Vec3, high: Vec3) => import("../base/types.js").View | null} [camera] the file's
 * @returns {{packet: import("./shapes.js").MeshPacket, view: import("../base/types.js").View, hasAllMaterials: boolean} | null} null as `joined`
 */
export function viewed(drawn, lamps, camera) {
  const found = joined(drawn, lamps);
  if (!found) return null;
  const { packet, places, hasAllMaterials } = found;
  const { low, high } = packet;
  return { packet, view: camera?.(low, high) ?? roomView(drawn, low, high) ?? frame(framedPlaces(drawn, places)), hasAllMaterials };
}

/** Returns whether all indices are below a limit. @param {Uint32Array} indices @param {number} limit */
export function isBelow(indices, limit) {
  for (const index of indices) if (index >= limit) return false;
  return true;
}
