/** A paginated list of the service, of which the page loads as many pages as requested. */

import { Store } from "../base/store.js";

/**
 * The store's value contains the loaded items; null until the first page was loaded.
 *
 * @template T
 * @extends {Store<T[] | null>}
 */
export class Listing extends Store {
  /** @param {(offset: number) => Promise<import("./api.js").Page<T>>} get returns a page after this number of items */
  constructor(get) {
    super(/** @type {T[] | null} */ (null));
    this.get = get;
    this.total = 0;
  }

  /** Whether the service has further items. */
  get hasMore() {
    return this.value !== null && this.value.length < this.total;
  }

  /** Reloads all pages loaded so far. */
  async load() {
    await this.upTo(this.value?.length ?? 0);
  }

  /** Loads the next page. */
  async more() {
    await this.upTo((this.value?.length ?? 0) + 1);
  }

  /** Inserts a separately fetched item at the beginning. @param {T} item */
  adopt(item) {
    this.set([item, ...(this.value ?? [])]);
  }

  /** @param {number} count load at least this many, if they exist */
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
