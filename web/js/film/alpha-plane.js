/**
 * The alpha of a film with a transparent background, for one side of the stage: fetched beside the colour, and again while the film
 * grows. The layer shows a checkerboard through what it does not cover.
 */

import { fetchImage } from "../news/api.js";

/** Minimum interval between fetches while the film grows. */
const EVERY_MS = 3000;

export class AlphaPlane {
  /**
   * @param {import("./picture-side.js").FilmSource} live with a transparent background
   * @param {import("./film-layer.js").FilmLayer} layer
   */
  constructor(live, layer) {
    this.live = live;
    this.layer = layer;
    /** Number of samples in the fetched plane. */
    this.madeOf = 0;
    this.waiting = false;
    this.fetching = new AbortController();
    layer.setCoverage(live.film); // of the live view from which the job was started
    // A fetch may take longer than the interval, so one that is under way is left alone.
    const renew = () => !this.waiting && live.film.total > this.madeOf && void this.fetch();
    this.timer = setInterval(renew, EVERY_MS);
    const unfill = live.onFill(renew);
    const unlisten = live.onTile(() => {
      if (!this.madeOf && !this.waiting) void this.fetch(); // at once with the first samples
    });
    const unturn = live.onTurn(() => {
      this.madeOf = 0;
      this.fetching.abort();
      layer.setAlpha(null);
      void this.fetch();
    });
    this.unlisten = () => {
      unfill();
      unlisten();
      unturn();
    };
    renew();
  }

  /** Fetches the plane; the last one stays until it arrives, also if that fails: the next interval tries again. */
  async fetch() {
    this.fetching.abort();
    const { signal } = (this.fetching = new AbortController());
    this.waiting = true;
    try {
      const { image, samples } = await fetchImage(this.live, { aov: "alpha" }, signal);
      if (signal.aborted) return image.close();
      this.madeOf = samples;
      this.layer.setAlpha(image);
    } catch {
      // Without samples there is no plane yet, and a lost connection is shown by the banner.
    } finally {
      if (!signal.aborted) this.waiting = false;
    }
  }

  dispose() {
    clearInterval(this.timer);
    this.fetching.abort();
    this.unlisten();
    this.layer.setAlpha(null);
  }
}
