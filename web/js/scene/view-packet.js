/**
 * A view's picture as it comes over the WebSocket. Little-endian:
 *
 *     u8 version = 1, u8 kind = 3, u16 tiles, u32 id, u32 seq, u16 width, u16 height, u16 whole width, u16 whole height,
 *     of each tile u16 x, y, w, h and u32 samples a pixel, then their RGB9E5 words, rows from the top
 */

const VERSION = 1;
const KIND_VIEW = 3;
const HEADER_BYTES = 20;
const TILE_BYTES = 12;

/** @typedef {import("../news/tile-packet.js").TilePacket} TilePacket */

/**
 * @typedef {object} ViewPicture
 * @property {number} id of the view that was asked for
 * @property {number} seq what the acknowledgement names
 * @property {number} width of this picture: the first of a view is a small one
 * @property {number} height
 * @property {TilePacket[]} tiles that have changed
 */

/**
 * @param {ArrayBuffer} buffer
 * @returns {ViewPicture}
 */
export function decodeView(buffer) {
  const view = new DataView(buffer);
  const version = view.getUint8(0);
  const kind = view.getUint8(1);
  if (version !== VERSION || kind !== KIND_VIEW)
    throw new Error(`A view of version ${version} and kind ${kind}; this page reads version ${VERSION}. Reload the page.`);
  const seq = view.getUint32(8, true);
  const count = view.getUint16(2, true);
  let at = HEADER_BYTES + count * TILE_BYTES;
  const tiles = Array.from({ length: count }, (_, number) => {
    const head = HEADER_BYTES + number * TILE_BYTES;
    const [x, y, w, h] = /** @type {[number, number, number, number]} */ (
      [0, 2, 4, 6].map((offset) => view.getUint16(head + offset, true))
    );
    const words = new Uint32Array(buffer, at, w * h);
    at += 4 * w * h;
    return { frame: 0, seq, x, y, w, h, spp: view.getUint32(head + 8, true), words };
  });
  if (at !== buffer.byteLength) throw new Error(`A view's tiles came with ${buffer.byteLength} bytes.`);
  return { id: view.getUint32(4, true), seq, width: view.getUint16(12, true), height: view.getUint16(14, true), tiles };
}
