/** Loads thumbnails a few at a time, latest request first, since that is visible. */

import { forgetImage, showImage } from "../news/images.js";

const AT_A_TIME = 4;
/** Number of attempts, since a frame may just be changing state. */
const TRIES = 4;
const RETRY_MS = 2500;

export class Thumbnails {
  constructor() {
    /** @type {Map<HTMLImageElement, string>} */
    this.waiting = new Map();
    /** @type {Set<HTMLImageElement>} */
    this.loading = new Set();
    /**
     * Failed thumbnails with the number of attempts and the timer of the next.
     * @type {Map<HTMLImageElement, {address: string, tries: number, timer: ReturnType<typeof setTimeout>}>}
     */
    this.failed = new Map();
  }

  /** @param {HTMLImageElement} image @param {string} address */
  ask(image, address) {
    this.waiting.delete(image);
    this.waiting.set(image, address);
    this.next();
  }

  /** Cancels a thumbnail that is out of sight. @param {HTMLImageElement} image */
  forget(image) {
    clearTimeout(this.failed.get(image)?.timer);
    this.failed.delete(image);
    this.waiting.delete(image);
    this.loading.delete(image);
    forgetImage(image);
    this.next();
  }

  /** @param {HTMLImageElement} image @param {string} address that did not come */
  tryAgain(image, address) {
    const before = this.failed.get(image);
    clearTimeout(before?.timer);
    const tries = before?.address === address ? before.tries + 1 : 1;
    const timer = setTimeout(() => tries < TRIES && !this.waiting.has(image) && this.ask(image, address), RETRY_MS * tries);
    this.failed.set(image, { address, tries, timer });
  }

  next() {
    while (this.loading.size < AT_A_TIME) {
      const found = [...this.waiting].find(([image]) => !this.loading.has(image));
      if (!found) return;
      const [image, address] = found;
      this.waiting.delete(image);
      this.loading.add(image);
      const done = () => {
        this.loading.delete(image);
        this.next();
      };
      showImage(image, address)
        .then(
          () => ((image.hidden = false), this.failed.delete(image)),
          () => ((image.hidden = true), this.tryAgain(image, address)),
        )
        .finally(done);
    }
  }
}
