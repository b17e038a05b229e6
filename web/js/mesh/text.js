/** Scans numbers and words in the bytes of a text file, without making strings of them. */

/** @typedef {Float32Array<ArrayBuffer> | Int32Array<ArrayBuffer> | Uint32Array<ArrayBuffer>} Numbers */

const [TAB, NEWLINE, RETURN, SPACE, PLUS, MINUS, DOT, BACKSLASH] = [9, 10, 13, 32, 43, 45, 46, 92];
const [UPPER_E, LOWER_E] = [69, 101];
const POWERS = Float64Array.from({ length: 309 }, (_, i) => Number(`1e${i}`));
/** Values of an array, above which a file is left to the service. */
export const MOST_VALUES = 2 ** 28;
const MOST_DIGITS = 2 ** 53 / 10 - 1; // of a mantissa that further digits keep exact

/** An array of numbers that grows. @template {Numbers} A */
export class Growing {
  /** @param {A} first */
  constructor(first) {
    this.values = first;
    this.length = 0;
  }

  /** @param {number} value */
  push(value) {
    if (this.length === this.values.length) {
      if (this.length >= MOST_VALUES) throw new RangeError("too many values");
      const larger = /** @type {A} */ (new /** @type {any} */ (this.values.constructor)(2 * this.length));
      larger.set(this.values);
      this.values = larger;
    }
    this.values[this.length++] = value;
  }

  /** @returns {A} */
  get whole() {
    return /** @type {A} */ (this.values.subarray(0, this.length));
  }
}

export const growingFloats = () => new Growing(new Float32Array(1 << 12));
export const growingIntegers = () => new Growing(new Int32Array(1 << 12));
export const growingIndices = () => new Growing(new Uint32Array(1 << 12));

export class Scanner {
  /** @param {Uint8Array<ArrayBuffer>} bytes @param {number} [at] */
  constructor(bytes, at = 0) {
    this.bytes = bytes;
    this.at = at;
  }

  get isOver() {
    return this.at >= this.bytes.length;
  }

  /** Goes to the next word of the line; a backslash before the line's end continues it. @returns {boolean} whether there is one */
  nextInLine() {
    const { bytes } = this;
    let { at } = this;
    for (; at < bytes.length; at++) {
      const code = bytes[at] ?? 0;
      if (code === SPACE || code === TAB) continue;
      const isContinued = code === BACKSLASH && (bytes[at + 1] === NEWLINE || bytes[at + 1] === RETURN);
      if (isContinued) {
        if (bytes[++at] === RETURN && bytes[at + 1] === NEWLINE) at++;
        continue;
      }
      this.at = at;
      return code !== NEWLINE && code !== RETURN;
    }
    this.at = at;
    return false;
  }

  /** Goes to the next word of the file. @returns {boolean} whether there is one */
  next() {
    const { bytes } = this;
    while (this.at < bytes.length && (bytes[this.at] ?? 0) <= SPACE) this.at++;
    return this.at < bytes.length;
  }

  /** Goes behind the line's end. */
  endLine() {
    const { bytes } = this;
    let { at } = this;
    while (at < bytes.length && bytes[at] !== NEWLINE && bytes[at] !== RETURN) at++;
    if (bytes[at] === RETURN && bytes[at + 1] === NEWLINE) at++;
    this.at = at + 1;
  }

  /** Returns the rest of the line. */
  line() {
    const first = this.at;
    this.endLine();
    return new TextDecoder().decode(this.bytes.subarray(first, this.at)).trim();
  }

  /** Returns the word that begins here, and goes behind it. */
  word() {
    const { bytes } = this;
    const first = this.at;
    while (this.at < bytes.length && (bytes[this.at] ?? 0) > SPACE) this.at++;
    return new TextDecoder().decode(bytes.subarray(first, this.at));
  }

  /** Returns the integer that begins here, and goes behind it; NaN, without moving, if there is none. */
  integer() {
    const { bytes } = this;
    let { at } = this;
    const sign = bytes[at];
    if (sign === MINUS || sign === PLUS) at++;
    const first = at;
    let value = 0;
    for (let digit = (bytes[at] ?? 0) - 48; digit >= 0 && digit <= 9; digit = (bytes[++at] ?? 0) - 48) value = 10 * value + digit;
    if (at === first) return NaN;
    this.at = at;
    return sign === MINUS ? -value : value;
  }

  /** Returns the decimal number that begins here, and goes behind its word; NaN if it is not one. */
  number() {
    const { bytes } = this;
    let { at } = this;
    const sign = bytes[at];
    if (sign === MINUS || sign === PLUS) at++;
    let value = 0;
    let exponent = 0;
    let digits = 0;
    let code = bytes[at] ?? 0;
    for (; code >= 48 && code <= 57; code = bytes[++at] ?? 0, digits++) {
      if (value < MOST_DIGITS) value = 10 * value + (code - 48);
      else exponent++;
    }
    if (code === DOT)
      for (code = bytes[++at] ?? 0; code >= 48 && code <= 57; code = bytes[++at] ?? 0, digits++)
        if (value < MOST_DIGITS) {
          value = 10 * value + (code - 48);
          exponent--;
        }
    if (digits && (code === LOWER_E || code === UPPER_E)) {
      this.at = at + 1;
      exponent += this.integer();
      at = this.at;
      code = bytes[at] ?? 0;
    }
    if (!digits || code > SPACE) {
      while ((bytes[at] ?? 0) > SPACE) at++;
      value = NaN;
    }
    this.at = at;
    const whole = exponent === 0 ? value : exponent > 0 ? value * (POWERS[exponent] ?? Infinity) : exponent > -309 ? value / (POWERS[-exponent] ?? 1) : 0;
    return sign === MINUS ? -whole : whole;
  }
}
