/** The files of an upload as a reader sees them: by path, also those in a zip, with the same choice of the scene's file as the service. */

/** @typedef {import("../shell/gather-files.js").NamedFile} NamedFile */

/** Bytes that may still be read of an upload, those in its zips included. @typedef {{left: number}} Budget */

/**
 * @typedef {object} Files
 * @property {string[]} names
 * @property {Budget} budget
 * @property {(name: string) => Promise<Uint8Array<ArrayBuffer>>} read
 */

const PICTURES = /** @type {Record<string, string>} */ ({ jpg: "image/jpeg", jpeg: "image/jpeg", png: "image/png", webp: "image/webp", gif: "image/gif", bmp: "image/bmp" });

/** Returns the media type of an image that browsers can read, by its name; "" for others. @param {string} name */
export const pictureType = (name) => PICTURES[name.slice(name.lastIndexOf(".") + 1).toLowerCase()] ?? "";

const AUXILIARY = ["control", "cage", "collision", "collider", "proxy", "lowpoly", "low_poly"];

/**
 * Returns the file that the service reads as the scene (pick_main of renderer/formats.py): the one of the best format, then that in
 * the fewest folders, of a name that marks no auxiliary file, of the shortest name.
 *
 * @param {string[]} names
 * @param {string[]} formats suffixes, best first
 * @returns {string | undefined}
 */
export function pickMain(names, formats) {
  /** @type {[number[], string][]} */
  const found = [];
  for (const name of names) {
    const parts = name.split("/");
    const title = (parts.at(-1) ?? "").toLowerCase();
    const rank = formats.indexOf(title.slice(title.lastIndexOf(".")));
    if (rank < 0 || parts.some((part) => part.startsWith(".") || part === "__MACOSX")) continue;
    found.push([[rank, parts.length, Number(AUXILIARY.some((word) => title.includes(word))), [...name].length], name]);
  }
  found.sort(([a, one], [b, other]) => a.reduce((sign, value, i) => sign || value - (b[i] ?? 0), 0) || (one < other ? -1 : 1));
  return found[0]?.[1];
}

/**
 * Returns the name of a file that another one refers to: relative to that one, or else the only one of that name in any folder.
 *
 * @param {string[]} names
 * @param {string} reference
 * @param {string} from
 * @returns {string | undefined}
 */
export function find(names, reference, from) {
  /** @type {string[]} */
  const path = [];
  for (const part of [...from.split("/").slice(0, -1), ...reference.replaceAll("\\", "/").split("/")])
    if (part === "..") path.pop();
    else if (part && part !== ".") path.push(part);
  const folded = (/** @type {string} */ name) => name.toLowerCase();
  const wanted = folded(path.join("/"));
  const title = folded(path.at(-1) ?? "");
  const exact = names.find((name) => folded(name) === wanted);
  if (exact) return exact;
  const alike = names.filter((name) => folded(name.slice(name.lastIndexOf("/") + 1)) === title);
  return alike.length === 1 ? alike[0] : undefined;
}

/**
 * @param {NamedFile[]} given files, or a single zip
 * @returns {Promise<Files>}
 */
export async function filesOf(given) {
  const [only, ...others] = given;
  const budget = { left: MOST_BYTES };
  if (only && !others.length && only.path.toLowerCase().endsWith(".zip")) return zipOf(only.file, budget);
  const byName = new Map(given.map(({ path, file }) => [path, file]));
  return readOnce(byName, budget, async (file) => new Uint8Array(await file.arrayBuffer()));
}

/**
 * Returns files with those in zips among them in place of the zips, as the service unpacks them if no file is a scene
 * (nested_archives of renderer/formats.py).
 *
 * @param {Files} files
 * @returns {Promise<Files>}
 */
export async function unpackedFiles(files) {
  /** @type {Map<string, () => Promise<Uint8Array<ArrayBuffer>>>} */
  const found = new Map();
  for (const name of files.names) {
    if (!name.toLowerCase().endsWith(".zip")) {
      found.set(name, () => files.read(name));
      continue;
    }
    const inner = await zipOf(new Blob([await files.read(name)]), files.budget);
    for (const each of inner.names) found.set(`${name.slice(0, -".zip".length)}/${each}`, () => inner.read(each));
  }
  return { names: [...found.keys()], budget: files.budget, read: async (name) => (await found.get(name)?.()) ?? Promise.reject(new Error("not here")) };
}

/**
 * Returns files that are each read once, however often others name them, as long as the budget lasts.
 *
 * @template {{size: number}} F
 * @param {Map<string, F>} byName
 * @param {Budget} budget
 * @param {(file: F) => Promise<Uint8Array<ArrayBuffer>>} load
 * @returns {Files}
 */
function readOnce(byName, budget, load) {
  /** @type {Map<string, Promise<Uint8Array<ArrayBuffer>>>} */
  const known = new Map();
  return {
    names: [...byName.keys()],
    budget,
    async read(name) {
      const before = known.get(name);
      if (before) return before;
      const file = byName.get(name);
      budget.left -= file?.size ?? 0;
      if (!file || budget.left < 0) throw new Error("not read here");
      const contents = load(file);
      known.set(name, contents);
      return contents;
    },
  };
}

const [END, ENTRY] = [0x06054b50, 0x02014b50];
const [STORED, DEFLATED] = [0, 8];
/** Bytes of the end record, and of the longest comment after it. */
const [END_BYTES, MOST_COMMENT] = [22, 65535];
/** Contents of more bytes are left to the service. */
const MOST_BYTES = 512 * 1024 * 1024;

/**
 * Reads a zip's directory. Source: PKWARE's APPNOTE.TXT, sections 4.3 and 4.4; without zip64.
 *
 * @param {Blob} file
 * @param {Budget} budget
 * @returns {Promise<Files>}
 */
async function zipOf(file, budget) {
  const tail = new DataView(await file.slice(Math.max(0, file.size - END_BYTES - MOST_COMMENT)).arrayBuffer());
  let end = tail.byteLength - END_BYTES;
  while (end >= 0 && tail.getUint32(end, true) !== END) end--;
  if (end < 0) throw new Error("no directory");
  const [count, bytes, start] = [tail.getUint16(end + 10, true), tail.getUint32(end + 12, true), tail.getUint32(end + 16, true)];
  const directory = new DataView(await file.slice(start, start + bytes).arrayBuffer());
  /** @type {Map<string, {method: number, packed: number, size: number, at: number}>} */
  const entries = new Map();
  for (let i = 0, at = 0; i < count && directory.getUint32(at, true) === ENTRY; i++) {
    const length = directory.getUint16(at + 28, true);
    const name = new TextDecoder().decode(new Uint8Array(directory.buffer, at + 46, length));
    const [method, packed, size] = [directory.getUint16(at + 10, true), directory.getUint32(at + 20, true), directory.getUint32(at + 24, true)];
    if (!name.endsWith("/")) entries.set(name, { method, packed, size, at: directory.getUint32(at + 42, true) });
    at += 46 + length + directory.getUint16(at + 30, true) + directory.getUint16(at + 32, true);
  }
  return readOnce(entries, budget, async ({ method, packed, size, at }) => {
    const head = new DataView(await file.slice(at, at + 30).arrayBuffer());
    const first = at + 30 + head.getUint16(26, true) + head.getUint16(28, true);
    const content = file.slice(first, first + packed);
    if (method === STORED) return new Uint8Array(await content.arrayBuffer());
    if (method !== DEFLATED) throw new Error("another compression");
    return inflated(content, "deflate-raw", size);
  });
}

/**
 * Decompresses. Rejects when the contents are damaged, not of the stated size, or too large for this page.
 *
 * @param {Blob} packed
 * @param {CompressionFormat} format
 * @param {number} size of the contents in bytes
 * @returns {Promise<Uint8Array<ArrayBuffer>>}
 */
export async function inflated(packed, format, size) {
  if (size > MOST_BYTES) throw new Error("too large");
  const found = new Uint8Array(size);
  let at = 0;
  const reader = packed.stream().pipeThrough(new DecompressionStream(format)).getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) break;
    found.set(value, at); // throws a RangeError beyond the stated size
    at += value.length;
  }
  if (at < size) throw new RangeError("cut off");
  return found;
}
