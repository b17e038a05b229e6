/** A view's pictures and drafts as the service sends them; protocol/pictures.py declares the layouts, protocol/coarse.py the coarse tiles. */

import { ALPHA, DRAFT_HEAD_BYTES, EXACT, VIEW_HEAD_BYTES, VIEW_TILE_HEAD_BYTES, decodeDraftHead, decodeViewHead, decodeViewTileHead } from "../base/protocol.js";
import { encode } from "../film/rgb9e5.js";

/** Sum of red, green and blue for each brightness code. */
const BRIGHTNESS = Float64Array.from({ length: 1 << 11 }, (_, code) =>
  code ? 2 ** (((code - 1) >> 5) - 24) * (1 + ((code - 1) & 31) / 32) : 0,
);

/** @typedef {import("../news/tile-packet.js").TilePacket} TilePacket */

/** A tile with its coverage before a transparent background, 0 to 255; null: opaque. @typedef {TilePacket & {alpha: Uint8Array | null}} ViewTile */

/**
 * @typedef {object} ViewPicture
 * @property {number} id of the requested view
 * @property {number} seq what the acknowledgement names
 * @property {number} width of this picture: the first of a view is a small one
 * @property {number} height
 * @property {ViewTile[]} tiles that have changed
 */

/**
 * A view's first picture where graphics cards render it, see `FilmLayer.setImage`.
 *
 * @typedef {object} ViewDraft
 * @property {number} id of the requested view
 * @property {number} seq what the acknowledgement names
 * @property {ImageBitmap} draft
 * @property {number} exposure of the draft, in stops
 */

/**
 * Decodes the JPEG outside the main thread.
 *
 * @param {ArrayBuffer} buffer
 * @returns {Promise<ViewDraft>}
 */
export async function decodeDraft(buffer) {
  const { id, seq, exposure } = decodeDraftHead(new DataView(buffer));
  const jpeg = new Blob([new Uint8Array(buffer, DRAFT_HEAD_BYTES)], { type: "image/jpeg" });
  return { id, seq, exposure, draft: await createImageBitmap(jpeg, { colorSpaceConversion: "none" }) };
}

/**
 * @param {ArrayBuffer} buffer
 * @returns {Promise<ViewPicture>}
 */
export async function decodeView(buffer) {
  const view = new DataView(buffer);
  const head = decodeViewHead(view);
  const tiles = Array.from({ length: head.tiles }, (_, number) => {
    const { samples, ...rect } = decodeViewTileHead(view, VIEW_HEAD_BYTES + number * VIEW_TILE_HEAD_BYTES);
    const isExact = samples >= EXACT;
    const words = new Uint32Array(rect.w * rect.h);
    return { frame: 0, seq: head.seq, ...rect, spp: samples % ALPHA, isExact, words, alpha: null, hasAlpha: samples % EXACT >= ALPHA };
  });
  const bytes = await inflated(buffer, VIEW_HEAD_BYTES + head.tiles * VIEW_TILE_HEAD_BYTES);
  const rough = tiles.filter((tile) => !tile.isExact);
  const exact = tiles.filter((tile) => tile.isExact);
  let at = unpackRough(bytes, rough);
  const covered = exact.reduce((sum, { words }) => sum + 4 * words.length, at);
  unpackExact(bytes.subarray(at, covered), exact);
  at = covered;
  const whole = tiles.map(({ hasAlpha, ...tile }) => ({ ...tile, alpha: hasAlpha ? bytes.slice(at, (at += tile.words.length)) : null }));
  return { id: head.id, seq: head.seq, width: head.w, height: head.h, tiles: whole };
}

/** @param {ArrayBuffer} buffer @param {number} from */
async function inflated(buffer, from) {
  const packed = new Blob([new Uint8Array(buffer, from)]).stream();
  return new Uint8Array(await new Response(packed.pipeThrough(new DecompressionStream("deflate-raw"))).arrayBuffer());
}

/** @param {Uint8Array} bytes @param {TilePacket[]} tiles @returns {number} how many bytes they took */
function unpackRough(bytes, tiles) {
  const pixels = tiles.reduce((sum, { w, h }) => sum + w * h, 0);
  const fours = tiles.reduce((sum, { w, h }) => sum + Math.ceil(w / 2) * Math.ceil(h / 2), 0);
  const [high, red, green] = [pixels, 2 * pixels, 2 * pixels + fours];
  for (const hue of [red, green])
    for (let i = hue + 1; i < hue + fours; i++) bytes[i] = (bytes[i] ?? 0) + (bytes[i - 1] ?? 0);
  let [at, four, code] = [0, 0, 0];
  for (const { w, h, words } of tiles) {
    const half = Math.ceil(w / 2);
    for (let i = 0, y = 0; y < h; y++) {
      for (let x = 0; x < w; x++, at++) {
        const folded = (bytes[at] ?? 0) | ((bytes[high + at] ?? 0) << 8);
        code += (folded >>> 1) ^ -(folded & 1);
        const hue = four + (y >> 1) * half + (x >> 1);
        const bright = (BRIGHTNESS[code] ?? 0) / 255;
        const [r, g] = [bytes[red + hue] ?? 0, bytes[green + hue] ?? 0];
        words[i++] = encode(bright * r, bright * g, bright * Math.max(0, 255 - r - g));
      }
    }
    four += half * Math.ceil(h / 2);
  }
  return green + fours;
}

/** @param {Uint8Array} planes @param {TilePacket[]} tiles */
function unpackExact(planes, tiles) {
  const pixels = tiles.reduce((sum, { w, h }) => sum + w * h, 0);
  if (planes.length !== 4 * pixels) throw new Error(`A view's tiles came with ${planes.length} bytes.`);
  let at = 0;
  for (const { words } of tiles) {
    const bytes = new Uint8Array(words.buffer);
    for (let plane = 0; plane < 4; plane++)
      for (let i = 0, from = plane * pixels + at; i < words.length; i++) bytes[4 * i + plane] = planes[from + i] ?? 0;
    at += words.length;
  }
}
