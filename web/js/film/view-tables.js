/**
 * OpenColorIO views of the farm's config as 3D tables, fetched when first shown, and the GLSL that looks them up.
 * protocol/view_table.py declares the layout; renderer/image/ocio.py makes the tables and states their error.
 */

import { VIEW_TABLE_HEAD_BYTES, decodeViewTableHead } from "../base/protocol.js";
import { fetchViewTable } from "../news/api.js";

/** @typedef {{size: number, words: Uint32Array}} ViewTable size: points an axis; words: RGB10, red fastest */

/** Null while a table is being fetched, or could not be. @type {Map<string, ViewTable | null>} */
const tables = new Map();
/** @type {Set<() => void>} */
const waiting = new Set();

/** @param {ArrayBuffer} buffer @returns {ViewTable} */
export function decodeViewTable(buffer) {
  const { size } = decodeViewTableHead(new DataView(buffer));
  if (buffer.byteLength !== VIEW_TABLE_HEAD_BYTES + 4 * size ** 3)
    throw new Error(`A view's table of ${size} points an axis came with ${buffer.byteLength} bytes.`);
  return { size, words: new Uint32Array(buffer, VIEW_TABLE_HEAD_BYTES) };
}

/**
 * @param {string} name of the view
 * @param {() => void} loaded called once, when the table has been fetched
 * @returns {ViewTable | null}
 */
export function viewTable(name, loaded) {
  const found = tables.get(name);
  if (found) return found;
  waiting.add(loaded);
  if (found === undefined) {
    tables.set(name, null);
    fetchViewTable(name).then(
      (packet) => {
        tables.set(name, decodeViewTable(packet));
        for (const each of waiting) each();
        waiting.clear();
      },
      // After an error, which is shown, the view is not tried again: each draw would show one more.
    );
  }
  return null;
}

export const VIEW_TABLE_GLSL = `
// Display values of a view by its table: points at log2(1 + 255 c) / 16 = 0 ... 1, interpolated in tetrahedra.
vec3 viewed(vec3 c) {
  float last = float(textureSize(viewTable, 0).x - 1);
  vec3 at = log2(1.0 + 255.0 * clamp(c, 0.0, 257.0)) / 16.0 * last;
  vec3 corner = clamp(floor(at), 0.0, last - 1.0);
  vec3 f = at - corner;
  ivec3 i = ivec3(corner);
  float most = max(f.r, max(f.g, f.b));
  float least = min(f.r, min(f.g, f.b));
  float middle = f.r + f.g + f.b - most - least;
  ivec3 first = f.r >= f.g && f.r >= f.b ? ivec3(1, 0, 0) : f.g >= f.b ? ivec3(0, 1, 0) : ivec3(0, 0, 1);
  ivec3 both = f.b <= f.r && f.b <= f.g ? ivec3(1, 1, 0) : f.g <= f.r ? ivec3(1, 0, 1) : ivec3(0, 1, 1);
  return (1.0 - most) * texelFetch(viewTable, i, 0).rgb + (most - middle) * texelFetch(viewTable, i + first, 0).rgb +
         (middle - least) * texelFetch(viewTable, i + both, 0).rgb + least * texelFetch(viewTable, i + 1, 0).rgb;
}
`;
