/**
 * The WebSocket of one job: state as JSON, tiles as binary packets, each acknowledged; reconnects when it breaks. It starts with
 * a snapshot of all tiles, or with those that differ from the page's (`have`).
 */

import { GONE, NOT_FOUND } from "../base/protocol.js";
import { LastingSocket } from "../base/lasting-socket.js";
import { decodeTile } from "./tile-packet.js";
import { t } from "../base/words.js";

/** @typedef {import("./tile-packet.js").TilePacket} TilePacket */

/**
 * @typedef {object} LiveHandlers
 * @property {(tile: TilePacket) => void} tile
 * @property {(message: Record<string, any>) => void} message
 * @property {(up: boolean) => void} link
 * @property {() => number[] | null} [have] samples a pixel of every tile that is here; null: it is sent later, by `sendHave`.
 *   Omitted: a snapshot is requested
 * @property {(sentence: string) => void} refused the service closed the connection for good
 */

export class Live extends LastingSocket {
  /**
   * @param {string} job
   * @param {number} frame whose tiles are sent
   * @param {LiveHandlers} handlers
   */
  constructor(job, frame, handlers) {
    super(handlers, t("The service closed the live picture."));
    this.handlers = handlers;
    this.job = job;
    this.frame = frame;
    /** The frame requested when the socket was opened. */
    this.asked = frame;
    /** Whether a state of the job has arrived. */
    this.connect();
  }

  /** @override */
  address() {
    this.asked = this.frame;
    return `api/jobs/${this.job}/live?frame=${this.frame}${this.handlers.have ? "&snapshot=false" : ""}`;
  }

  /** @override */
  onOpen() {
    if (this.frame !== this.asked) this.turnTo(this.frame);
    this.sendHave();
  }

  /** @override @param {Record<string, any>} message */
  onMessage(message) {
    this.handlers.message(message);
  }

  /** @override @param {ArrayBuffer} packet */
  onPacket(packet) {
    const tile = decodeTile(packet);
    this.handlers.tile(tile);
    this.send({ ack: tile.seq });
  }

  /** @override @param {number} code @param {string} reason */
  onEnd(code, reason) {
    const isClosedToUs = code === NOT_FOUND && this.hasHeard; // a deleted job is reported differently
    if (isClosedToUs || ![NOT_FOUND, GONE].includes(code)) super.onEnd(code, reason); // otherwise the farm's events report it too
  }

  /**
   * Switches to the tiles of another frame, starting with all of them or, as at the beginning, with those that differ.
   * @param {number} frame
   */
  turnTo(frame) {
    this.frame = frame;
    this.send({ frame, snapshot: !this.handlers.have });
  }

  /** Sends the samples of the page's tiles, once they are known. */
  sendHave() {
    const have = this.handlers.have?.();
    if (have) this.send({ have });
  }
}
