/**
 * A live tile as sent over the WebSocket. Little-endian:
 *
 *     u8 version = 1, u8 kind = 1, u16 frame, u32 seq, u16 x, y, w, h, u32 spp, then w * h RGB9E5 words, rows from the top
 */

import { FILM_HEAD_BYTES, TILE_HEAD_BYTES, decodeFilmHead, decodeTileHead } from "../base/protocol.js";

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
  const head = decodeTileHead(new DataView(buffer));
  const { w, h } = head;
  if (buffer.byteLength !== TILE_HEAD_BYTES + 4 * w * h)
    throw new Error(`A live tile of ${w}×${h} came with ${buffer.byteLength} bytes.`);
  return { ...head, words: new Uint32Array(buffer, TILE_HEAD_BYTES) };
}

/**
 * A whole film: the samples of each tile, and the colour of all pixels.
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
 * @param {ArrayBuffer} buffer
 * @returns {FilmPacket}
 */
export function decodeFilm(buffer) {
  const { frame, w: width, h: height, side } = decodeFilmHead(new DataView(buffer));
  const tiles = Math.ceil(width / side) * Math.ceil(height / side);
  const pixels = width * height;
  if (buffer.byteLength !== FILM_HEAD_BYTES + 4 * tiles + 4 * pixels)
    throw new Error(`A film of ${width}×${height} came with ${buffer.byteLength} bytes.`);
  const spp = new Uint32Array(buffer, FILM_HEAD_BYTES, tiles);
  const planes = new Uint8Array(buffer, FILM_HEAD_BYTES + 4 * tiles);
  const words = new Uint32Array(pixels);
  const bytes = new Uint8Array(words.buffer);
  for (let plane = 0; plane < 4; plane++)
    for (let i = 0, from = plane * pixels; i < pixels; i++) bytes[4 * i + plane] = planes[from + i] ?? 0;
  return { frame, width, height, side, spp, words };
}
