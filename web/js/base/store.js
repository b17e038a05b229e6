/** A value that notifies listeners of changes. */

/** @template T */
export class Store {
  /** @param {T} value */
  constructor(value) {
    this.value = value;
    /** @type {Set<(value: T) => void>} */
    this.listeners = new Set();
  }

  /** @param {T} value */
  set(value) {
    this.value = value;
    for (const listener of [...this.listeners]) listener(value);
  }

  /** @param {(value: T) => T} change */
  update(change) {
    this.set(change(this.value));
  }

  /**
   * Calls the listener now and after every change.
   *
   * @param {(value: T) => void} listener
   * @returns {() => void} ends it
   */
  subscribe(listener) {
    this.listeners.add(listener);
    listener(this.value);
    return () => this.listeners.delete(listener);
  }
}

/** Collects the cleanup actions of a view, run when it is left. */
export class Disposer {
  constructor() {
    /** @type {(() => void)[]} */
    this.undo = [];
  }

  /** @param {() => unknown} undo */
  add(undo) {
    this.undo.push(undo);
  }

  /**
   * Adds an event listener that is removed on disposal.
   *
   * @param {EventTarget} target
   * @param {string} type
   * @param {(event: any) => void} listener
   * @param {AddEventListenerOptions} [options]
   */
  listen(target, type, listener, options) {
    target.addEventListener(type, listener, options);
    this.add(() => target.removeEventListener(type, listener, options));
  }

  /**
   * @param {number} ms
   * @param {() => void} tick
   */
  every(ms, tick) {
    const timer = setInterval(tick, ms);
    this.add(() => clearInterval(timer));
  }

  dispose() {
    for (const undo of this.undo.splice(0).reverse()) undo();
  }
}
