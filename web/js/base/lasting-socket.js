/** A WebSocket that reconnects when the connection breaks, falls silent, or the service restarts. */

import { Backoff } from "./backoff.js";
import { said } from "./said.js";

/** The service sends a message at least every few seconds. A silent connection is dead, for example after a laptop woke up. */
const SILENCE_MS = 20_000;

/** Message codes of the service's reasons for closing a socket, by WebSocket close code, since the reason text has no code. */
const CLOSED = /** @type {Record<number, string>} */ ({ 4401: "login-expired", 4404: "project-membership-ended" });

/**
 * @typedef {object} SocketHandlers
 * @property {(up: boolean) => void} link
 * @property {(sentence: string) => void} refused the service closed the connection for good
 */

export class LastingSocket {
  /**
   * @param {SocketHandlers} handlers
   * @param {string} refusal message if the service closes the connection for good without a reason
   */
  constructor(handlers, refusal) {
    this.link = handlers.link;
    this.refused = handlers.refused;
    this.refusal = refusal;
    this.backoff = new Backoff();
    /** @type {WebSocket | null} */
    this.socket = null;
    this.lastHeard = 0;
    this.hasHeard = false;
    this.watchdog = setInterval(() => this.checkSilence(), SILENCE_MS / 4);
  }

  /** The URL, relative to the page, with scheme https: or http:. @returns {string} */
  address() {
    throw new Error("nowhere");
  }

  /** Called after the connection opened, to send initial messages. */
  onOpen() {}

  /** @param {any} _message JSON */
  onMessage(_message) {}

  /** @param {ArrayBuffer} _packet */
  onPacket(_packet) {}

  connect() {
    const url = new URL(this.address(), location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    url.hash = "";
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.lastHeard = performance.now();
    socket.onopen = () => {
      this.backoff.succeeded();
      this.link(true);
      this.onOpen();
    };
    socket.onmessage = ({ data }) => {
      if (this.socket !== socket) return; // closed while the message was on its way
      this.lastHeard = performance.now();
      this.hasHeard = true;
      if (typeof data === "string") this.onMessage(JSON.parse(data));
      else this.onPacket(data);
    };
    socket.onclose = ({ code, reason }) => {
      if (this.socket !== socket) return;
      if (code === 1008 || (code >= 4000 && code < 5000)) {
        this.onEnd(code, reason);
        return;
      }
      this.link(false);
      this.backoff.schedule(() => this.connect());
    };
  }

  /** Called when the service closed the connection for good. @param {number} code @param {string} reason */
  onEnd(code, reason) {
    const known = this.hasHeard ? CLOSED[code] : undefined;
    this.refused(reason ? said(reason, known ? { code: known, params: {} } : null) : this.refusal);
  }

  /** @param {object} message dropped if the connection is not open */
  send(message) {
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
