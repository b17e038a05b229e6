/** Small pictures that are loaded a few at a time: what is asked for last, which is what is in sight, comes first. */

const AT_A_TIME = 4;

export class Thumbnails {
  constructor() {
    /** @type {Map<HTMLImageElement, string>} */
    this.waiting = new Map();
    /** @type {Set<HTMLImageElement>} */
    this.loading = new Set();
  }

  /** @param {HTMLImageElement} image @param {string} address */
  ask(image, address) {
    this.waiting.delete(image);
    this.waiting.set(image, address);
    this.next();
  }

  /** It is out of sight. @param {HTMLImageElement} image */
  forget(image) {
    this.waiting.delete(image);
    this.loading.delete(image);
    image.onload = image.onerror = null;
    image.removeAttribute("src"); // ends what is under way
    this.next();
  }

  next() {
    while (this.loading.size < AT_A_TIME) {
      const found = [...this.waiting].find(([image]) => !this.loading.has(image));
      if (!found) return;
      const [image, address] = found;
      this.waiting.delete(image);
      this.loading.add(image);
      const done = (/** @type {boolean} */ shown) => () => {
        image.hidden = !shown;
        this.loading.delete(image);
        this.next();
      };
      image.onload = done(true);
      image.onerror = done(false);
      image.src = address;
    }
  }
}
