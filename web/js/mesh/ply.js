/** Reads PLY files, text and binary of both byte orders, for a preview: surfaces, points, and 3D Gaussians as points. Files of strips are left to the service. */

import { MOST_VALUES, Scanner, growingIndices } from "./text.js";
import { GREY, WHITE, modelOf } from "./model.js";
import { pointShape } from "./points.js";

/** @typedef {{name: string, type: string, count: string | null}} Property count: the type of a list's length; null: no list */
/** @typedef {{name: string, count: number, properties: Property[]}} Element */
/** Returns the value that comes next, of a type. @typedef {(type: string) => number} Next */

/** Types by both of their names. @type {Record<string, string>} */
const TYPES = {
  ...{ char: "int8", uchar: "uint8", short: "int16", ushort: "uint16", int: "int32", uint: "uint32", float: "float32", double: "float64" },
  ...{ int8: "int8", uint8: "uint8", int16: "int16", uint16: "uint16", int32: "int32", uint32: "uint32", float32: "float32", float64: "float64" },
};
/** Largest values of the types of colours. @type {Record<string, number>} */
const HIGHEST = { uint8: 255, int8: 255, uint16: 65535, int32: 255, uint32: 255, int16: 32767 };
const CORNERS = ["vertex_indices", "vertex_index", "vertex_indexes"];
const UVS = [["s", "t"], ["u", "v"], ["texture_u", "texture_v"]];
/** Terms of 3D Gaussians' colours that no direction changes, and the value of their basis function. */
const [SPLATS, CONSTANT] = [["f_dc_0", "f_dc_1", "f_dc_2"], 0.28209479177387814];
const COLORS = [["red", "green", "blue"], ["diffuse_red", "diffuse_green", "diffuse_blue"], ["r", "g", "b"]];

/**
 * @param {Uint8Array<ArrayBuffer>} file
 * @param {(reference: string) => Promise<import("./shapes.js").Picture | null>} picture returns an image that the file names
 * @param {number} [most] triangles, about
 * @returns {Promise<import("./shapes.js").LocalMesh | null>} null if the file is damaged
 */
export async function readPly(file, picture, most) {
  const head = headOf(file);
  const next = head && nextOf(file, head.at, head.format);
  if (!next || !(leastBytes(head.elements) <= Math.min(file.length, MOST_VALUES))) return null; // before arrays of the stated size are made
  /** @type {Record<string, Float32Array>} */
  let columns = {};
  /** @type {Element | undefined} */
  let vertex;
  const indices = growingIndices();
  for (const element of head.elements) {
    if (element.name === "vertex" && !element.properties.some(({ count }) => count)) {
      vertex = element;
      columns = columnsOf(element, next);
    } else readFaces(element, next, indices);
  }
  const { x, y, z } = columns;
  if (!vertex || !x || !y || !z) return null;
  const among = (/** @type {string[][]} */ sets) => sets.find((names) => names.every((name) => columns[name]));
  const positions = interleaved([x, y, z]);
  const normal = among([["nx", "ny", "nz"]]);
  const uv = among(UVS);
  const uvs = uv ? interleaved(uv.map((name) => /** @type {Float32Array} */ (columns[name]))) : null;
  if (uvs) for (let i = 1; i < uvs.length; i += 2) uvs[i] = 1 - (uvs[i] ?? 0);
  const rgb = among(COLORS);
  const colors = rgb ? colorsOf(rgb.map((name) => /** @type {Float32Array} */ (columns[name])), vertex.properties.find(({ name }) => name === rgb[0])?.type ?? "") : null;
  if (!indices.whole.length) {
    if (head.elements.some(({ name }) => name === "tristrips")) return null;
    const terms = rgb ? null : among([SPLATS]);
    const cloud = pointShape(positions, terms ? splatColors(terms.map((name) => /** @type {Float32Array} */ (columns[name]))) : colors);
    return cloud && modelOf([{ shape: cloud, color: cloud.colors ? WHITE : GREY, image: null }], terms ? "-y" : "y", true, cloud.indices.length / 3);
  }
  const image = uvs && head.pictures.length === 1 ? await picture(head.pictures[0] ?? "") : null;
  const shape = { positions, normals: normal ? interleaved(normal.map((name) => /** @type {Float32Array} */ (columns[name]))) : null, uvs, colors, indices: indices.whole };
  return modelOf([{ shape, color: colors || image ? WHITE : GREY, image }], "y", image !== null, most);
}

/**
 * @param {Uint8Array<ArrayBuffer>} file
 * @returns {{format: string, elements: Element[], pictures: string[], at: number} | null} at: where the data begin
 */
function headOf(file) {
  const text = new Scanner(file);
  /** @type {Element[]} */
  const elements = [];
  /** @type {string[]} */
  const pictures = [];
  let format = "";
  if (text.line() !== "ply") return null;
  while (!text.isOver) {
    const line = text.line();
    const [keyword, ...words] = line.split(/\s+/);
    if (keyword === "end_header") return { format, elements, pictures, at: text.at };
    if (keyword === "format") format = words[0] ?? "";
    if (keyword === "comment" && words[0] === "TextureFile") pictures.push(line.replace(/^comment\s+TextureFile\s+/, ""));
    if (keyword === "element") elements.push({ name: words[0] ?? "", count: Number(words[1]), properties: [] });
    if (keyword === "property") {
      const [count, type] = words[0] === "list" ? [TYPES[words[1] ?? ""], TYPES[words[2] ?? ""]] : [null, TYPES[words[0] ?? ""]];
      if (!type || count === undefined) return null;
      elements.at(-1)?.properties.push({ name: words.at(-1) ?? "", type, count });
    }
  }
  return null;
}

/** Returns the number of bytes that a file with such elements has at least: one a value. @param {Element[]} elements */
const leastBytes = (elements) => elements.reduce((sum, { count, properties }) => sum + count * Math.max(properties.length, 1), 0);

/** Returns a function that reads the values of a file, one by one. @param {Uint8Array<ArrayBuffer>} file @param {number} at @param {string} format @returns {Next | null} */
function nextOf(file, at, format) {
  if (format === "ascii") {
    const text = new Scanner(file, at);
    return () => {
      if (!text.next()) throw new RangeError("cut off");
      return text.number();
    };
  }
  if (!["binary_little_endian", "binary_big_endian"].includes(format)) return null;
  const view = new DataView(file.buffer, file.byteOffset, file.length); // throws a RangeError beyond the file's end
  const isLittle = format === "binary_little_endian";
  let place = at;
  return (type) => {
    const from = place;
    switch (type) {
      case "float32":
        place += 4;
        return view.getFloat32(from, isLittle);
      case "int32":
        place += 4;
        return view.getInt32(from, isLittle);
      case "uint32":
        place += 4;
        return view.getUint32(from, isLittle);
      case "uint8":
        place += 1;
        return view.getUint8(from);
      case "int8":
        place += 1;
        return view.getInt8(from);
      case "uint16":
        place += 2;
        return view.getUint16(from, isLittle);
      case "int16":
        place += 2;
        return view.getInt16(from, isLittle);
      default:
        place += 8;
        return view.getFloat64(from, isLittle);
    }
  };
}

/** Reads an element without lists. @param {Element} element @param {Next} next @returns {Record<string, Float32Array>} by name */
function columnsOf({ count, properties }, next) {
  const columns = properties.map(() => new Float32Array(count));
  const types = properties.map(({ type }) => type);
  for (let i = 0; i < count; i++) for (let k = 0; k < columns.length; k++) /** @type {Float32Array} */ (columns[k])[i] = next(/** @type {string} */ (types[k]));
  return Object.fromEntries(properties.map(({ name }, k) => [name, /** @type {Float32Array} */ (columns[k])]));
}

/** Reads another element: of polygons the triangles, else nothing. @param {Element} element @param {Next} next @param {import("./text.js").Growing<any>} indices */
function readFaces({ name, count, properties }, next, indices) {
  const isFace = name === "face" || name === "faces";
  for (let i = 0; i < count; i++)
    for (const { name: property, type, count: length } of properties) {
      if (!length) {
        next(type);
        continue;
      }
      const corners = next(length);
      const isShown = isFace && CORNERS.includes(property);
      let [first, last] = [0, 0];
      for (let k = 0; k < corners; k++) {
        const index = next(type);
        if (k === 0) first = index;
        if (k > 1 && isShown) {
          indices.push(first);
          indices.push(last);
          indices.push(index);
        }
        last = index;
      }
    }
}

/** @param {Float32Array[]} columns @returns {Float32Array} their values, row by row */
function interleaved(columns) {
  const width = columns.length;
  const found = new Float32Array(width * (columns[0]?.length ?? 0));
  columns.forEach((column, k) => column.forEach((value, i) => (found[width * i + k] = value)));
  return found;
}

/** @param {Float32Array[]} terms @returns {Uint8Array} sRGB, three a point */
const splatColors = (terms) => Uint8Array.from(interleaved(terms), (value) => Math.round(255 * Math.min(Math.max(0.5 + CONSTANT * value, 0), 1)));

/** @param {Float32Array[]} columns @param {string} type @returns {Uint8Array} three a vertex */
function colorsOf(columns, type) {
  const values = interleaved(columns);
  const highest = HIGHEST[type] ?? (values.some((value) => value > 1) ? 255 : 1);
  return Uint8Array.from(values, (value) => Math.round(255 * Math.min(Math.max(value / highest, 0), 1)));
}
