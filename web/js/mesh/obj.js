/** Reads OBJ files with their materials for a preview. Polygons are cut into fans. Source: Alias/Wavefront, Advanced Visualizer Manual, appendix B1. */

import { Scanner, growingFloats, growingIntegers } from "./text.js";
import { GREY, WHITE, coded, modelOf } from "./model.js";
import { dielectric, phongRoughness } from "./surface.js";

/** @typedef {import("./shapes.js").Picture} Picture */
/** @typedef {import("./shapes.js").Shape} Shape */
/** isWhole: whether the service would show the same. @typedef {{color: number[], image: Picture | null, surface?: Partial<import("../news/mesh-packet.js").MeshMaterial>, isWhole: boolean}} Material */

/**
 * Access to the files beside an OBJ file.
 *
 * @typedef {object} Beside
 * @property {string[]} names of all files in the OBJ file's folder
 * @property {(reference: string) => Promise<Uint8Array<ArrayBuffer> | null>} read
 * @property {(reference: string) => Promise<Picture | null>} picture
 */

/**
 * What a file states.
 *
 * @typedef {object} Statements
 * @property {Float32Array} positions three a vertex
 * @property {Float32Array | null} painted three a vertex, in the file's range
 * @property {Float32Array} uvs
 * @property {Float32Array} normals
 * @property {Int32Array} corners three a corner: position, UV, normal, from 0; -1: none. Three corners a triangle
 * @property {[number, string][]} materials first triangle of each stretch, and its material
 * @property {[number, string][]} smoothing first triangle of each stretch, and its smoothing group
 * @property {string[]} libraries
 */

/**
 * @param {Uint8Array<ArrayBuffer>} file
 * @param {Beside} beside
 * @param {number} [most] triangles, about
 * @returns {Promise<import("./shapes.js").LocalMesh | null>} null if the file is damaged
 */
export async function readObj(file, beside, most) {
  const said = statementsOf(file);
  if (!said) return null;
  const materials = await materialsOf(said.libraries, beside);
  const lone = !said.libraries.length && said.uvs.length ? await loneImage(beside) : null;
  const count = said.corners.length / 9;
  const groups = groupsOf(said.smoothing, count);
  const isFlat = groups !== null && !groups.some(Boolean) && !said.normals.length;
  const highest = highestOf(said.painted ?? new Float32Array());
  let isWhole = true;
  const parts = stretches(said.materials, count).flatMap(([name, ranges]) => {
    const material = materials.get(name) ?? materials.get(withoutComment(name)) ?? { color: lone || said.painted ? WHITE : GREY, image: lone, isWhole: true };
    isWhole &&= material.isWhole;
    return shapesOf(said, ranges, groups, highest).map((shape) => ({ shape: isFlat ? { ...shape, normals: new Float32Array(shape.positions.length) } : shape, ...material }));
  });
  return modelOf(parts, "y", isWhole, most);
}

const [TAB, SPACE, HASH, SLASH] = [9, 32, 35, 47];
const [F, G, M, N, S, T, U, V] = [102, 103, 109, 110, 115, 116, 117, 118];

/** @param {Uint8Array<ArrayBuffer>} file @returns {Statements | null} null if a face is malformed */
export function statementsOf(file) {
  const text = new Scanner(file);
  const [positions, painted, uvs, normals, corners] = [growingFloats(), growingFloats(), growingFloats(), growingFloats(), growingIntegers()];
  /** @type {Statements} */
  const said = { positions: positions.whole, painted: null, uvs: uvs.whole, normals: normals.whole, corners: corners.whole, materials: [], smoothing: [], libraries: [] };
  const face = new Int32Array(9); // the first, the last and the next corner
  /** @param {import("./text.js").Growing<any>} table @param {number} width */
  const row = (table, width) => {
    for (let k = 0; k < width; k++) table.push(text.nextInLine() ? text.number() : k ? 0 : NaN);
  };
  const isBlank = (/** @type {number | undefined} */ code) => code === SPACE || code === TAB;
  for (; !text.isOver; text.endLine()) {
    if (!text.nextInLine()) continue;
    const { at } = text;
    const code = file[at];
    if (code === V && isBlank(file[at + 1])) {
      text.at = at + 1;
      row(positions, 3);
      if (!text.nextInLine() || file[text.at] === HASH) continue;
      const first = text.number(); // a weight, or the first of three colour values
      if (!text.nextInLine() || file[text.at] === HASH) continue;
      while (painted.length < positions.length - 3) painted.push(NaN);
      painted.push(first);
      row(painted, 2);
    } else if (code === V && file[at + 1] === T) {
      text.at = at + 2;
      row(uvs, 2);
    } else if (code === V && file[at + 1] === N) {
      text.at = at + 2;
      row(normals, 3);
    } else if (code === F && isBlank(file[at + 1])) {
      text.at = at + 1;
      const counts = [positions.length / 3, uvs.length / 2, normals.length / 3];
      for (let count = 0; text.nextInLine() && file[text.at] !== HASH; count++) {
        const to = count === 0 ? 0 : count === 1 ? 3 : 6;
        face[to + 1] = face[to + 2] = -1;
        for (let k = 0; k < 3; k++) {
          if (k && file[text.at] !== SLASH) break;
          if (k) text.at++;
          const index = text.integer();
          if (k && Number.isNaN(index)) continue; // v//vn
          const number = index < 0 ? index + (counts[k] ?? 0) : index - 1;
          if (!(number >= 0) && !k) return null;
          face[to + k] = number;
        }
        if ((file[text.at] ?? SPACE) > SPACE) return null;
        if (count < 2) continue;
        for (let k = 0; k < 9; k++) corners.push(face[k] ?? 0);
        face.copyWithin(3, 6);
      }
    } else if (code === U || code === M || code === S || code === G) {
      const keyword = text.word();
      const value = text.nextInLine() ? text.line() : "";
      const triangle = corners.length / 9;
      if (keyword === "usemtl") said.materials.push([triangle, value]);
      else if (keyword === "mtllib") said.libraries.push(value);
      else if (keyword === "s") said.smoothing.push([triangle, withoutComment(value).toLowerCase().split(/\s/)[0] ?? ""]);
      text.at--; // the line's end
    }
  }
  if (painted.length) while (painted.length < positions.length) painted.push(NaN);
  return { ...said, positions: positions.whole, painted: painted.length ? painted.whole : null, uvs: uvs.whole, normals: normals.whole, corners: corners.whole };
}

/** @param {string} words */
const withoutComment = (words) => (words.split(/(?:^|\s)#/)[0] ?? "").trim();

/** @param {[number, string][]} smoothing @param {number} count of triangles @returns {Int32Array | null} each triangle's group, 0: flat; null: the file has no groups */
function groupsOf(smoothing, count) {
  if (!smoothing.length) return null;
  const numbers = new Map([["", 0], ["0", 0], ["off", 0]]);
  const found = new Int32Array(count);
  smoothing.forEach(([first, name], i) => {
    const number = numbers.get(name) ?? numbers.size;
    numbers.set(name, number);
    found.fill(number, first, smoothing[i + 1]?.[0] ?? count);
  });
  return found;
}

/** @param {[number, string][]} materials @param {number} count of triangles @returns {[string, [number, number][]][]} each material's ranges of triangles */
function stretches(materials, count) {
  /** @type {Map<string, [number, number][]>} */
  const found = new Map();
  [/** @type {[number, string]} */ ([0, ""]), ...materials].forEach(([first, name], i) => {
    const last = materials[i]?.[0] ?? count;
    if (first >= last) return;
    const ranges = found.get(name) ?? [];
    ranges.push([first, last]);
    found.set(name, ranges);
  });
  return [...found];
}

/**
 * Returns the triangles of ranges as at most two shapes: those with normals at all corners, and the others.
 *
 * @param {Statements} said
 * @param {[number, number][]} ranges
 * @param {Int32Array | null} groups
 * @param {number} highest of the painted values
 * @returns {Shape[]}
 */
function shapesOf({ positions, painted, uvs, normals, corners }, ranges, groups, highest) {
  const most = ranges.reduce((sum, [first, last]) => sum + last - first, 0);
  const scale = 255 / (highest > 255 ? 65535 : highest > 1 ? 255 : 1);
  let slots = 1;
  while (slots < 6 * most) slots *= 2;
  const slotOf = new Int32Array(slots); // a hash table with open addressing: 1 + the vertex
  const cornerOf = new Int32Array(3 * most); // of each vertex
  /** @type {Shape[]} */
  const found = [];
  for (const hasNormals of [true, false]) {
    const indices = new Uint32Array(3 * most);
    const group = groups && new Int32Array(most);
    let [vertices, length, hasUvs] = [0, 0, false];
    slotOf.fill(0);
    for (const [begin, end] of ranges)
      for (let triangle = begin; triangle < end; triangle++) {
        const at = 9 * triangle;
        const isSmooth = (corners[at + 2] ?? 0) >= 0 && (corners[at + 5] ?? 0) >= 0 && (corners[at + 8] ?? 0) >= 0;
        if (isSmooth !== hasNormals) continue;
        if (group) group[length / 3] = groups[triangle] ?? 0;
        for (let corner = at; corner < at + 9; corner += 3) {
          const v = corners[corner] ?? 0;
          const t = corners[corner + 1] ?? 0;
          const n = hasNormals ? (corners[corner + 2] ?? 0) : 0;
          if (t >= 0) hasUvs = true;
          let slot = Math.imul(Math.imul(v, 73856093) ^ Math.imul(t, 19349663) ^ Math.imul(n, 83492791), 0x9e3779b1);
          slot = (slot ^ (slot >>> 15)) & (slots - 1);
          for (;;) {
            const known = (slotOf[slot] ?? 0) - 1;
            if (known < 0) {
              cornerOf[vertices++] = corner;
              slotOf[slot] = vertices;
              indices[length++] = vertices - 1;
              break;
            }
            const other = cornerOf[known] ?? 0;
            if (corners[other] === v && corners[other + 1] === t && (!hasNormals || corners[other + 2] === n)) {
              indices[length++] = known;
              break;
            }
            slot = (slot + 1) & (slots - 1);
          }
        }
      }
    if (!length) continue;
    /** @param {Float32Array} table @param {number} width @param {number} which of the corner's indices */
    const rows = (table, width, which) => {
      const values = new Float32Array(width * vertices);
      for (let i = 0; i < vertices; i++) {
        const from = width * (corners[(cornerOf[i] ?? 0) + which] ?? -1);
        if (from >= table.length) throw new RangeError("a face names a vertex that is not there");
        if (from >= 0) for (let k = 0; k < width; k++) values[width * i + k] = table[from + k] ?? 0;
      }
      return values;
    };
    const texels = hasUvs ? rows(uvs, 2, 1) : null;
    if (texels) for (let i = 1; i < texels.length; i += 2) texels[i] = 1 - (texels[i] ?? 0); // OBJ measures v from the image's lower edge
    found.push({
      ...{ positions: rows(positions, 3, 0), normals: hasNormals ? rows(normals, 3, 2) : null, uvs: texels },
      colors: painted && Uint8Array.from(rows(painted, 3, 0), (value) => (Number.isNaN(value) ? 255 : Math.round(Math.min(Math.max(value * scale, 0), 255)))),
      ...{ groups: group && group.slice(0, length / 3), indices: indices.slice(0, length) },
    });
  }
  return found;
}

/** @param {Float32Array} values some NaN */
const highestOf = (values) => values.reduce((highest, value) => (value > highest ? value : highest), 0);

/** @param {string[]} libraries @param {Beside} beside @returns {Promise<Map<string, Material>>} */
async function materialsOf(libraries, beside) {
  /** @type {Map<string, Material>} */
  const found = new Map();
  /** @type {Set<Uint8Array>} */
  const parsed = new Set(); // a file may be named by every object
  for (const library of libraries) {
    const words = withoutComment(library);
    const whole = (await beside.read(library)) ?? (await beside.read(words));
    const files = whole ? [whole] : await Promise.all(words.split(/\s+/).map(beside.read));
    for (const file of files) {
      if (!file || parsed.has(file)) continue;
      parsed.add(file);
      for (const [name, material] of await readMtl(file, beside)) found.set(name, material);
    }
  }
  return found;
}

/** Textures and surfaces that this preview lacks. */
const FURTHER = ["decal", "map_ke", "map_emissive", "map_d", "map_opacity", "map_pr", "map_pm", "map_ks"];
/** Illumination models: of glass, of mirrors, and without highlights. */
const [GLASS, MIRRORS, MATTE] = [["4", "6", "7", "9"], ["3", "5"], ["0", "1"]];
/** First line of files written by Blender. */
const BLENDERS = /^# Blender \d+\.\d+/;
const [METAL, SMOOTHEST] = ["3", 1000];
const PHYSICAL = ["pr", "pm", "ps", "pc", "map_pr", "map_pm"];
const MAP_OPTIONS = /^(?:-(?:mm|o|s|t)(?:\s+[-+.\de]+){1,3}|-\w+\s+\S+)\s+/i;

/** @param {Uint8Array<ArrayBuffer>} file @param {Beside} beside @returns {Promise<Map<string, Material>>} */
async function readMtl(file, beside) {
  /** @type {Map<string, Record<string, string>>} */
  const statements = new Map();
  /** @type {Record<string, string> | undefined} */
  let current;
  const text = new TextDecoder().decode(file);
  for (const line of text.split(/\r\n|\r|\n/)) {
    const [, keyword = "", value = ""] = /^(\S+)\s*(.*)$/.exec(line.trim()) ?? [];
    if (keyword.toLowerCase() === "newmtl") statements.set(value, (current = statements.get(value) ?? {}));
    else if (current && !keyword.startsWith("#")) current[keyword.toLowerCase()] = value;
  }
  /** @type {Map<string, Material>} */
  const found = new Map();
  for (const [name, values] of statements) {
    const map = values["map_kd"];
    const image = map ? ((await beside.picture(map)) ?? (await beside.picture(withoutOptions(map)))) : null;
    const base = numbersOf(values["kd"]) ?? [0.8, 0.8, 0.8];
    const isWhole = !FURTHER.some((keyword) => values[keyword]) && (!map || image !== null) && !MAP_OPTIONS.test(map ?? "");
    const { color, surface } = surfaceOf(values, image && (Math.max(...base) === 0 || !values["kd"]) ? [1, 1, 1] : base, image !== null, BLENDERS.test(text));
    found.set(withoutComment(name), { color, image: surface.transmission ? null : image, surface, isWhole: isWhole && !surface.transmission }); // the service looks whether glass is a pane
  }
  return found;
}

/**
 * Returns a material's colour and how it reflects, as renderer/scene/readers/mtl.py reads materials.
 *
 * @param {Record<string, string>} values of its statements
 * @param {number[]} base
 * @param {boolean} hasMap
 * @param {boolean} isBlenders whether Blender has written it, which stores its own parameters in these
 * @returns {{color: number[], surface: Partial<import("../news/mesh-packet.js").MeshMaterial>}}
 */
function surfaceOf(values, base, hasMap, isBlenders) {
  const at = (/** @type {string} */ keyword, otherwise = 0) => numbersOf(values[keyword])?.[0] ?? otherwise;
  const [specular, shininess, index] = [numbersOf(values["ks"]) ?? [0, 0, 0], at("ns"), at("ni", 1.5)];
  const ior = index > 1 ? Math.min(index, 5) : 1.5;
  const model = withoutComment(values["illum"] ?? "");
  const isBlack = Math.max(...base) < 0.05 && !hasMap;
  const isPhysical = PHYSICAL.some((keyword) => values[keyword]);
  const emission = /** @type {import("./shapes.js").Vec3} */ (numbersOf(values["ke"]) ?? [0, 0, 0]);
  const given = Math.min(Math.max(values["d"] === undefined ? 1 - at("tr") : at("d", 1), 0), 1);
  const opacity = given || 1; // some exporters write 0 for opaque
  const own = { emission, alpha_mode: opacity < 1 ? /** @type {const} */ ("blend") : /** @type {const} */ ("opaque") };
  const withOpacity = (/** @type {number[]} */ color) => [...coded(color), Math.round(255 * opacity)];
  if (isBlenders) {
    const roughness = values["pr"] ? at("pr") : 1 - Math.sqrt(Math.min(Math.max(shininess, 0), SMOOTHEST) / SMOOTHEST);
    const metallic = isPhysical ? at("pm") : model === METAL ? (numbersOf(values["ka"]) ?? [1, 1, 1]).reduce((sum, value) => sum + value / 3, 0) : 0;
    const level = Math.min(2 * Math.max(...(numbersOf(values["ks"]) ?? [0.5])), 1);
    const transmission = isPhysical ? Math.max(...(numbersOf(values["tf"]) ?? [0])) : 0;
    return { color: withOpacity(base), surface: { ...own, roughness, metallic, ior, transmission, f0: dielectric(ior, [1, 1, 1], level), coat: at("pc") / 4, coat_roughness: at("pcr") } };
  }
  if (!isPhysical && GLASS.includes(model)) return { color: [...coded(numbersOf(values["tf"]) ?? [1, 1, 1]), 255], surface: { emission, transmission: 1, roughness: 0, ior, f0: dielectric(ior) } };
  if (!isPhysical && isBlack && MIRRORS.includes(model) && Math.max(...specular) > 0) return { color: [...coded(specular), 255], surface: { emission, metallic: 1, roughness: 0 } };
  const roughness = values["pr"] ? at("pr") : phongRoughness(shininess);
  if (!isPhysical && isBlack && Math.max(...specular) > 0.3 && shininess > 1) return { color: withOpacity(specular), surface: { ...own, metallic: 1, roughness } };
  const isGlossy = isPhysical || (Math.max(...specular) > 0 && shininess > 1 && !MATTE.includes(model));
  if (!isGlossy) return { color: withOpacity(base), surface: own };
  const level = values["ks"] ? Math.min(2 * Math.max(...specular), 1) : 1; // exporters write 0.5 for a reflectance of 4 %
  return { color: withOpacity(base), surface: { ...own, roughness, metallic: at("pm"), coat: at("pc"), coat_roughness: at("pcr"), f0: dielectric(ior, [1, 1, 1], level) } };
}

/** @param {string} map */
function withoutOptions(map) {
  let rest = map;
  while (MAP_OPTIONS.test(rest)) rest = rest.replace(MAP_OPTIONS, "");
  return withoutComment(rest);
}

/** @param {string | undefined} words @returns {number[] | null} three, the first one thrice if it is alone */
function numbersOf(words) {
  const values = withoutComment(words ?? "").replaceAll(",", ".").split(/\s+/).map(Number);
  if (!words || values.some((value) => !Number.isFinite(value))) return null;
  return values.length >= 3 ? values.slice(0, 3) : [values[0] ?? 0, values[0] ?? 0, values[0] ?? 0];
}

/** Returns the only image beside a file that names no materials, as the service takes it. @param {Beside} beside */
async function loneImage({ names, picture }) {
  const images = names.filter((name) => /\.(jpe?g|png|webp|gif|bmp|tga|tiff?)$/i.test(name));
  return images.length === 1 ? picture(images[0] ?? "") : null;
}
