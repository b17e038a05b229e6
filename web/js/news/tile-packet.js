/**
 * A live tile as it comes over the WebSocket. Little-endian:
 *
 *     u8 version = 1, u8 kind = 1, u16 frame, u32 seq, u16 x, y, w, h, u32 spp, then w * h RGB9E5 words, rows from the top
 */

const VERSION = 1;
const KIND_TILE = 1;
const HEADER_BYTES = 20;
const KIND_FILM = 2;
const FILM_HEADER_BYTES = 12;

/**
 * @typedef {object} TilePacket
 * @property {number} frame
 * @property {number} seq what the acknowledgement names
 * @property {number} x
 * @property {number} y
 * @property {number} w
 * @property {number} h
 * @property {number} spp samples that each pixel of the tile has
 * @property {Uint32Array} words RGB9E5, w * h of them
 */

/**
 * @param {ArrayBuffer} buffer
 * @returns {TilePacket}
 */
export function decodeTile(buffer) {
  const view = new DataView(buffer);
  const version = view.getUint8(0);
  const kind = view.getUint8(1);
  if (version !== VERSION || kind !== KIND_TILE) {
    throw new Error(
      `A live packet of version ${version} and kind ${kind}; this page reads version ${VERSION}. Reload the page.`,
    );
  }
  const [x, y, w, h] = /** @type {[number, number, number, number]} */ (
    [8, 10, 12, 14].map((at) => view.getUint16(at, true))
  );
  if (buffer.byteLength !== HEADER_BYTES + 4 * w * h) {
    throw new Error(`A live tile of ${w}×${h} came with ${buffer.byteLength} bytes.`);
  }
  return {
    frame: view.getUint16(2, true),
    seq: view.getUint32(4, true),
    ...{ x, y, w, h },
    spp: view.getUint32(16, true),
    words: new Uint32Array(buffer, HEADER_BYTES),
  };
}

/**
 * A whole film: what every tile has, and all of its light.
 *
 * @typedef {object} FilmPacket
 * @property {number} frame
 * @property {number} width
 * @property {number} height
 * @property {number} side of a tile
 * @property {Uint32Array} spp samples a pixel of every tile, in reading order
 * @property {Uint32Array} words RGB9E5, rows from the top
 */

/**
 * A frame's film as it comes in one answer. Little-endian:
 *
 *     u8 version = 1, u8 kind = 2, u16 frame, u16 w, h, u32 side of a tile, then u32 samples of every tile, then w * h RGB9E5
 *     words in four planes of bytes, the lowest first
 *
 * @param {ArrayBuffer} buffer
 * @returns {FilmPacket}
 */
export function decodeFilm(buffer) {
  const view = new DataView(buffer);
  const [version, kind] = [view.getUint8(0), view.getUint8(1)];
  if (version !== VERSION || kind !== KIND_FILM) throw new Error(`A film of version ${version} and kind ${kind}.`);
  const width = view.getUint16(4, true);
  const height = view.getUint16(6, true);
  const side = view.getUint32(8, true);
  const tiles = Math.ceil(width / side) * Math.ceil(height / side);
  const pixels = width * height;
  if (buffer.byteLength !== FILM_HEADER_BYTES + 4 * tiles + 4 * pixels)
    throw new Error(`A film of ${width}×${height} came with ${buffer.byteLength} bytes.`);
  const spp = new Uint32Array(buffer, FILM_HEADER_BYTES, tiles);
  const planes = new Uint8Array(buffer, FILM_HEADER_BYTES + 4 * tiles);
  const words = new Uint32Array(pixels);
  const bytes = new Uint8Array(words.buffer);
  for (let plane = 0; plane < 4; plane++)
    for (let i = 0, from = plane * pixels; i < pixels; i++) bytes[4 * i + plane] = planes[from + i] ?? 0;
  return { frame: view.getUint16(2, true), width, height, side, spp, words };
}
