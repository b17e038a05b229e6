/** A list of which the service tells a page at a time, and the page shows as much as was asked for. */

import { Store } from "../base/store.js";

/**
 * Its value: what is here; null until the service has told.
 *
 * @template T
 * @extends {Store<T[] | null>}
 */
export class Listing extends Store {
  /** @param {(offset: number) => Promise<import("./api.js").Page<T>>} get a page, of what comes after so many */
  constructor(get) {
    super(/** @type {T[] | null} */ (null));
    this.get = get;
    this.total = 0;
  }

  /** Whether the service has more than is here. */
  get hasMore() {
    return this.value !== null && this.value.length < this.total;
  }

  /** Asks for it anew, as far as it was here. */
  async load() {
    await this.upTo(this.value?.length ?? 0);
  }

  /** Asks for the next page too. */
  async more() {
    await this.upTo((this.value?.length ?? 0) + 1);
  }

  /** One that was asked for by itself comes first. @param {T} item */
  adopt(item) {
    this.set([item, ...(this.value ?? [])]);
  }

  /** @param {number} count at least so many, as far as there are */
  async upTo(count) {
    /** @type {T[]} */
    const found = [];
    let page;
    do {
      page = await this.get(found.length);
      found.push(...page.items);
    } while (page.items.length && found.length < count);
    this.total = page.total;
    this.set(found);
  }
}
