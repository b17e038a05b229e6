/** The WebSocket of a live view: sends views, receives pictures. After a reconnection it requests the latest view again. */

import { LastingSocket } from "../base/lasting-socket.js";
import { DRAFT_KIND } from "../base/protocol.js";
import { decodeDraft, decodeView } from "./view-packet.js";
import { saidOf } from "../base/said.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Vec3} Vec3 */

/**
 * @typedef {object} ViewState
 * @property {number | null} id
 * @property {number} samples minimum over all pixels of the whole view
 * @property {number} bound
 * @property {number} mean mean samples per pixel
 * @property {number | null} noise relative; null while unknown
 * @property {boolean} done
 * @property {number} slots
 * @property {boolean} denoised whether the picture that is shown is denoised
 * @property {number | null} [denoised_samples] its samples per pixel; 0: it is smaller than the view
 * @property {boolean} denoises whether denoised pictures of the view come
 * @property {number | null} [sample_s] seconds of a slot for a sample of a pixel; null while unknown
 * @property {string | null} message why no new pictures arrive
 * @property {import("../base/types.js").Codes} [codes]
 *
 * @typedef {object} Picked the surface under a pixel; depth, position and normal are null if there is none
 * @property {number} x
 * @property {number} y
 * @property {Vec3 | null} direction direction of the pixel's camera ray; null: unknown at present
 * @property {number | null} depth from the eye
 * @property {Vec3 | null} position
 * @property {Vec3 | null} normal
 *
 * @typedef {object} ViewHandlers
 * @property {(id: number) => void} asked the latest view is requested, again after the connection was lost, with this id
 * @property {(picture: import("./view-packet.js").ViewPicture) => void} picture
 * @property {(draft: import("./view-packet.js").ViewDraft) => void} draft
 * @property {(state: ViewState) => void} state
 * @property {(sentence: string) => void} failed the view is invalid: called with the reason in the page's language
 * @property {(picked: Picked) => void} picked
 * @property {(up: boolean) => void} link
 * @property {(sentence: string) => void} refused the service closed the connection for good
 *
 * @typedef {Record<string, (said: any) => void>} MoreHandlers of further messages of protocol/viewport.py, by their type
 */

export class ViewLink extends LastingSocket {
  /** @param {string} scene @param {ViewHandlers & MoreHandlers} handlers */
  constructor(scene, handlers) {
    super(handlers, t("The service closed the view."));
    this.scene = scene;
    this.handlers = handlers;
    this.id = 0;
    /** The requested view. @type {Record<string, any> | null} */
    this.wanted = null;
    /** A view waits for the next animation frame, since mouse events are more frequent. */
    this.pending = 0;
    /** Resolves when the latest picture is shown: pictures are unpacked in parallel and shown in order. */
    this.shown = /** @type {Promise<unknown>} */ (Promise.resolve());
    /** Whether pictures are paused, since they are not visible. */
    this.rests = false;
    this.seen = () => this.send({ paused: document.hidden || this.rests });
    document.addEventListener("visibilitychange", this.seen);
    this.connect();
  }

  /** @override */
  address() {
    return `api/scenes/${encodeURIComponent(this.scene)}/viewport`;
  }

  /** @override */
  onOpen() {
    if (document.hidden || this.rests) this.seen();
    this.ask();
  }

  /** @override @param {any} said */
  onMessage(said) {
    const { socket } = this;
    // A state is that of the picture sent before it, which may still be unpacked.
    if (said.type === "state") void this.shown.then(() => this.socket === socket && this.handlers.state(said));
    else if (said.type !== "error") this.handlers[said.type]?.(said);
    else if (said.id === null || said.id === this.id) this.handlers.failed(saidOf(said, "detail"));
  }

  /** @override @param {ArrayBuffer} packet */
  onPacket(packet) {
    const { socket } = this;
    const isDraft = new Uint8Array(packet)[1] === DRAFT_KIND;
    this.shown = Promise.allSettled([isDraft ? decodeDraft(packet) : decodeView(packet), this.shown]).then(([picture]) => {
      if (this.socket !== socket) {
        if (picture.status === "fulfilled" && "draft" in picture.value) picture.value.draft.close(); // no layer takes it
        return;
      }
      if (picture.status === "rejected") {
        this.handlers.failed(String(picture.reason.message ?? picture.reason));
        return;
      }
      if ("draft" in picture.value) this.handlers.draft(picture.value);
      else this.handlers.picture(picture.value);
      this.send({ ack: picture.value.seq });
    });
  }

  /** @param {boolean} on whether to pause the pictures */
  rest(on) {
    if (on === this.rests) return;
    this.rests = on;
    this.seen();
  }

  /** Whether a picture is of the view that is requested now, and no other is about to be. @param {number | null | undefined} id of the picture's view */
  isLatest(id) {
    return id === this.id && !this.pending;
  }

  /** @param {Record<string, any>} view the new view, as a job's request */
  show(view) {
    this.wanted = view;
    this.pending ||= requestAnimationFrame(() => this.ask());
  }

  ask() {
    cancelAnimationFrame(this.pending);
    this.pending = 0;
    if (!this.wanted || this.socket?.readyState !== WebSocket.OPEN) return;
    this.id += 1;
    this.handlers.asked(this.id);
    this.send({ id: this.id, ...this.wanted });
  }

  /** @override */
  close() {
    cancelAnimationFrame(this.pending);
    document.removeEventListener("visibilitychange", this.seen);
    super.close();
  }
}
