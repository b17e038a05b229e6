/**
 * The WebSocket of one job: state as JSON, tiles as binary packets, an acknowledgement for each, and a new connection when
 * it breaks. It begins with a snapshot of all tiles, or with what differs from what the page says that it has (`have`).
 */

import { Backoff } from "../base/backoff.js";
import { decodeTile } from "./tile-packet.js";
import { t } from "../base/words.js";

/** @typedef {import("./tile-packet.js").TilePacket} TilePacket */

/** A silent connection is dead: the service speaks at least every few seconds, and laptops wake up with dead sockets. */
const SILENCE_MS = 20_000;

/** What the service closes the connection of a job with that is deleted, or was never there. */
const GONE = [4404, 4410];

/**
 * @typedef {object} LiveHandlers
 * @property {(tile: TilePacket) => void} tile
 * @property {(message: Record<string, any>) => void} message
 * @property {(up: boolean) => void} link
 * @property {() => number[] | null} [have] samples a pixel of every tile that is here; null: that is said later, by `sayHave`.
 *   Left out: a snapshot is asked for
 * @property {(sentence: string) => void} refused the service closed the connection for good
 */

export class Live {
  /**
   * @param {string} job
   * @param {number} frame whose tiles are sent
   * @param {LiveHandlers} handlers
   */
  constructor(job, frame, handlers) {
    this.handlers = handlers;
    this.job = job;
    this.frame = frame;
    this.backoff = new Backoff();
    /** @type {WebSocket | null} */
    this.socket = null;
    this.lastHeard = 0;
    this.watchdog = setInterval(() => this.checkSilence(), SILENCE_MS / 4);
    this.connect();
  }

  url() {
    const url = new URL(`api/jobs/${this.job}/live`, location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    url.hash = "";
    url.search = `frame=${this.frame}${this.handlers.have ? "&snapshot=false" : ""}`;
    return url;
  }

  connect() {
    const socket = new WebSocket(this.url());
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.lastHeard = performance.now();
    const asked = this.frame;
    socket.onopen = () => {
      if (this.frame !== asked) this.turnTo(this.frame);
      this.sayHave();
      this.backoff.succeeded();
      this.handlers.link(true);
    };
    socket.onmessage = ({ data }) => {
      if (this.socket !== socket) return; // closed while this was on its way
      this.lastHeard = performance.now();
      if (typeof data === "string") {
        this.handlers.message(JSON.parse(data));
        return;
      }
      const tile = decodeTile(data);
      this.handlers.tile(tile);
      if (this.socket === socket) socket.send(JSON.stringify({ ack: tile.seq }));
    };
    socket.onclose = ({ code, reason }) => {
      if (this.socket !== socket) return;
      if (GONE.includes(code)) return; // the farm's news say so too
      if (code === 1008 || (code >= 4000 && code < 5000)) {
        this.handlers.refused(reason || t("The service closed the live picture."));
        return;
      }
      this.handlers.link(false);
      this.backoff.schedule(() => this.connect());
    };
  }

  /** From now on the tiles of another frame, first all of them; or what differs, as at the beginning. @param {number} frame */
  turnTo(frame) {
    this.frame = frame;
    this.say({ frame, snapshot: !this.handlers.have });
  }

  /** What the page has is known now. */
  sayHave() {
    const have = this.handlers.have?.();
    if (have) this.say({ have });
  }

  /** @param {object} message */
  say(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  checkSilence() {
    if (this.socket?.readyState === WebSocket.OPEN && performance.now() - this.lastHeard > SILENCE_MS)
      this.socket.close();
  }

  close() {
    clearInterval(this.watchdog);
    this.backoff.cancel();
    const socket = this.socket;
    this.socket = null;
    socket?.close(1000);
  }
}
