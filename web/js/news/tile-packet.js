/**
 * A live tile as it comes over the WebSocket. Little-endian:
 *
 *     u8 version = 1, u8 kind = 1, u16 frame, u32 seq, u16 x, y, w, h, u32 spp, then w * h RGB9E5 words, rows from the top
 */

const VERSION = 1;
const KIND_TILE = 1;
const HEADER_BYTES = 20;

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
