/**
 * The WebSocket on which a scene is looked at: a view goes there, pictures come back. When it breaks, or the service starts
 * anew, a new one asks for the view that was wanted last.
 */

import { Backoff } from "../base/backoff.js";
import { decodeView } from "./view-packet.js";
import { t } from "../base/words.js";

/** A silent connection is dead: the service speaks at least every few seconds. */
const SILENCE_MS = 20_000;

/**
 * @typedef {object} ViewState
 * @property {number | null} id
 * @property {number} samples of the whole view, in every pixel
 * @property {number} bound
 * @property {number} mean samples of a pixel, on the average
 * @property {number | null} noise relative; null while it is not known
 * @property {boolean} done
 * @property {number} slots
 * @property {string | null} message why nothing new comes
 *
 * @typedef {{x: number, y: number, depth: number | null, position: import("../base/types.js").Vec3 | null}} Picked
 *
 * @typedef {object} ViewHandlers
 * @property {(picture: import("./view-packet.js").ViewPicture) => void} picture
 * @property {(state: ViewState) => void} state
 * @property {(sentence: string) => void} failed the view makes no sense
 * @property {(picked: Picked) => void} picked
 * @property {(up: boolean) => void} link
 * @property {(sentence: string) => void} refused the service closed the connection for good
 */

export class ViewLink {
  /** @param {string} scene @param {ViewHandlers} handlers */
  constructor(scene, handlers) {
    this.scene = scene;
    this.handlers = handlers;
    this.backoff = new Backoff();
    this.id = 0;
    /** The view that is wanted. @type {Record<string, any> | null} */
    this.wanted = null;
    /** A view waits for the next drawn frame: a mouse says more often where it is. */
    this.pending = 0;
    /** @type {WebSocket | null} */
    this.socket = null;
    this.lastHeard = 0;
    /** The picture that came last is shown: they are unpacked beside each other, and shown in their order. */
    this.shown = Promise.resolve();
    this.watchdog = setInterval(() => this.checkSilence(), SILENCE_MS / 4);
    this.seen = () => this.say({ paused: document.hidden });
    document.addEventListener("visibilitychange", this.seen);
    this.connect();
  }

  connect() {
    const url = new URL(`api/scenes/${encodeURIComponent(this.scene)}/viewport`, location.href);
    url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
    url.hash = "";
    const socket = new WebSocket(url);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.lastHeard = performance.now();
    socket.onopen = () => {
      this.backoff.succeeded();
      this.handlers.link(true);
      if (document.hidden) this.seen();
      this.ask();
    };
    socket.onmessage = ({ data }) => {
      if (this.socket !== socket) return;
      this.lastHeard = performance.now();
      if (typeof data === "string") {
        this.hear(JSON.parse(data));
        return;
      }
      const coming = decodeView(data);
      this.shown = Promise.allSettled([coming, this.shown]).then(([picture]) => {
        if (this.socket !== socket) return;
        if (picture.status === "rejected") {
          this.handlers.failed(String(picture.reason.message ?? picture.reason));
          return;
        }
        this.handlers.picture(picture.value);
        this.say({ ack: picture.value.seq });
      });
    };
    socket.onclose = ({ code, reason }) => {
      if (this.socket !== socket) return;
      if (code === 1008 || (code >= 4000 && code < 5000)) {
        this.handlers.refused(reason || t("The service closed the view."));
        return;
      }
      this.handlers.link(false);
      this.backoff.schedule(() => this.connect());
    };
  }

  /** @param {any} said */
  hear(said) {
    if (said.type === "state") this.handlers.state(said);
    else if (said.type === "picked") this.handlers.picked(said);
    else if (said.type === "error" && (said.id === null || said.id === this.id)) this.handlers.failed(said.detail);
  }

  /** @param {Record<string, any>} view what is to be seen from now on: a job's request */
  show(view) {
    this.wanted = view;
    this.pending ||= requestAnimationFrame(() => this.ask());
  }

  ask() {
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    if (!this.wanted || this.socket?.readyState !== WebSocket.OPEN) return;
    this.id += 1;
    this.say({ id: this.id, ...this.wanted });
  }

  /** @param {Record<string, any>} message */
  say(message) {
    if (this.socket?.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }

  checkSilence() {
    if (this.socket?.readyState === WebSocket.OPEN && performance.now() - this.lastHeard > SILENCE_MS)
      this.socket.close();
  }

  close() {
    clearInterval(this.watchdog);
    cancelAnimationFrame(this.pending);
    document.removeEventListener("visibilitychange", this.seen);
    this.backoff.cancel();
    const socket = this.socket;
    this.socket = null;
    socket?.close(1000);
  }
}
