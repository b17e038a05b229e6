/** An AOV, fetched as the service's picture of it and renewed while the job runs. */

import { imageUrl } from "./api.js";

const EVERY_MS = 3000;

export class AovImage {
  /**
   * @param {string} job
   * @param {{show: (image: ImageBitmap | null) => void, waiting: (yes: boolean) => void, failed: (error: unknown) => void}} handlers
   */
  constructor(job, handlers) {
    this.job = job;
    this.handlers = handlers;
    this.channel = "";
    this.fetching = new AbortController();
    this.timer = setInterval(() => this.stale && !this.busy && void this.load(), EVERY_MS);
    this.busy = false;
    /** The film changed since the picture was fetched. */
    this.stale = false;
  }

  /** @param {string} channel "" for none */
  choose(channel) {
    if (channel === this.channel) return;
    this.channel = channel;
    this.fetching.abort();
    this.handlers.waiting(channel !== "");
    if (channel) void this.load();
    else this.handlers.show(null);
  }

  async load() {
    if (!this.channel) return;
    this.stale = false;
    this.fetching.abort();
    const fetching = (this.fetching = new AbortController());
    this.busy = true;
    try {
      const response = await fetch(imageUrl(this.job, "png", { aov: this.channel }), {
        signal: fetching.signal,
      });
      if (!response.ok) throw new Error(`The service gave no picture of it (status ${response.status}).`);
      const image = await createImageBitmap(await response.blob(), {
        colorSpaceConversion: "none",
        premultiplyAlpha: "none",
      });
      if (fetching.signal.aborted) image.close();
      else this.handlers.show(image);
    } catch (error) {
      if (!fetching.signal.aborted) this.handlers.failed(error);
    } finally {
      if (!fetching.signal.aborted) {
        this.busy = false;
        this.handlers.waiting(false);
      }
    }
  }

  dispose() {
    clearInterval(this.timer);
    this.fetching.abort();
  }
}
