/** A picture as a texture: a film's RGB9E5 words, updated tile by tile, or a finished image (an AOV) instead. */

/** @typedef {import("./film.js").Film} Film */
/** Coverage before a transparent background, 0 to 255, rows from the top. @typedef {{width: number, height: number, bytes: Uint8Array}} Coverage */
/** @typedef {import("../news/tile-packet.js").TilePacket} TilePacket */

/** What a texture has: radiance, display values, or a draft's logarithms of radiance. */
export const [LINEAR, DISPLAY, LOGARITHMIC] = [0, 1, 2];

export class FilmLayer {
  /**
   * @param {WebGL2RenderingContext} gl
   * @param {() => void} changed
   * @param {() => void} [gotTile] called instead for a single tile
   */
  constructor(gl, changed, gotTile = changed) {
    this.gl = gl;
    this.changed = changed;
    this.gotTile = gotTile;
    /** Called before a film replaces another one gradually. */
    this.beforeFade = () => {};
    /** @type {Film | null} */
    this.film = null;
    /** Shown instead of the film. @type {ImageBitmap | null} */
    this.image = null;
    /** Exposure of the image's logarithmic scale, in stops; null: the image has display values. @type {number | null} */
    this.draftExposure = null;
    /** Added to the look's exposure for this layer's picture, in stops. */
    this.moreExposure = 0;
    /** @type {WebGLTexture | null} */
    this.texture = null;
    /** Format and size of the allocated texture. */
    this.room = "";
    /** Coverage of a film before a transparent background, as grey or as bytes; null: all is covered. @type {ImageBitmap | Coverage | null} */
    this.alpha = null;
    /** @type {WebGLTexture | null} */
    this.alphaTexture = null;
  }

  /** @returns {{width: number, height: number} | null} of the shown picture, in pixels */
  get size() {
    return this.image ?? this.film;
  }

  /** @param {Film | null} film of a size that textures may have @param {{fades?: boolean}} [how] fades: whether what is shown fades into it */
  setFilm(film, { fades = false } = {}) {
    if (this.film === film && !this.image) return;
    if (fades) this.beforeFade();
    this.dropImage();
    this.film = film;
    this.upload();
  }

  /**
   * @param {ImageBitmap} image display values, sRGB-coded, or a draft; it is this layer's from now on
   * @param {number | null} [draftExposure] of a draft, see `DraftHead` in protocol/pictures.py
   */
  setImage(image, draftExposure = null) {
    this.dropImage();
    this.image = image;
    this.draftExposure = draftExposure;
    this.upload();
  }

  /** Whether the checkerboard is shown through what the film does not cover. */
  get hasAlpha() {
    return this.alphaTexture !== null && this.image === null;
  }

  /** @param {ImageBitmap | Coverage | null} image it is this layer's from now on; null: the film covers everything */
  setAlpha(image) {
    if (this.alpha && "close" in this.alpha) this.alpha.close();
    this.alpha = image;
    this.uploadAlpha();
    this.changed();
  }

  /** Shows the alpha that a film brings with it. @param {Film} film */
  setCoverage({ width, height, coverage }) {
    if (coverage || this.alpha) this.setAlpha(coverage && { width, height, bytes: coverage });
  }

  uploadAlpha() {
    const { gl, alpha } = this;
    gl.deleteTexture(this.alphaTexture);
    this.alphaTexture = null;
    if (!alpha) return;
    this.alphaTexture = newTexture(gl, "bytes" in alpha ? gl.R8 : gl.RGBA8, alpha);
    if ("bytes" in alpha) {
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 1);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, alpha.width, alpha.height, gl.RED, gl.UNSIGNED_BYTE, alpha.bytes);
      gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
    } else gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, gl.RGBA, gl.UNSIGNED_BYTE, alpha);
  }

  /** @param {Film} film that the tile was put into @param {TilePacket} tile */
  putTile(film, { x, y, w, h, words }) {
    const { gl } = this;
    if (film !== this.film || this.image || x + w > film.width || y + h > film.height) return;
    gl.bindTexture(gl.TEXTURE_2D, this.texture);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, x, y, w, h, gl.RGB, gl.UNSIGNED_INT_5_9_9_9_REV, words);
    this.gotTile();
  }

  /** Recreates the texture after the context was lost. */
  restore() {
    this.room = "";
    this.uploadAlpha();
    this.upload();
  }

  /** Fills the texture; allocates a new one if the size has changed. */
  upload() {
    const { gl, film, image } = this;
    this.makeRoom(image ? gl.RGBA8 : gl.RGB9_E5, image ?? film);
    if (image) {
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, gl.RGBA, gl.UNSIGNED_BYTE, image);
    } else if (film) {
      const { width, height, words } = film;
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, width, height, gl.RGB, gl.UNSIGNED_INT_5_9_9_9_REV, words);
    }
    this.changed();
  }

  /**
   * @param {GLenum} format
   * @param {{width: number, height: number} | null} size null: for nothing
   */
  makeRoom(format, size) {
    const { gl } = this;
    const room = size ? `${format} ${size.width} ${size.height}` : "";
    if (room && room === this.room) {
      gl.bindTexture(gl.TEXTURE_2D, this.texture);
      return;
    }
    gl.deleteTexture(this.texture);
    this.texture = null;
    this.room = room;
    if (!size) return;
    this.texture = newTexture(gl, format, size);
  }

  /** The shader's number for what the texture has. */
  get coding() {
    return this.image === null ? LINEAR : this.draftExposure === null ? DISPLAY : LOGARITHMIC;
  }

  /** Returns the factor of the texture's values that shows them at an exposure. @param {number} exposure in stops */
  gainAt(exposure) {
    return 2 ** (exposure + this.moreExposure - (this.draftExposure ?? 0));
  }

  dropImage() {
    this.image?.close();
    this.image = null;
    this.draftExposure = null;
  }

  clear() {
    this.setFilm(null);
    this.setAlpha(null);
  }
}

/**
 * Returns a new texture, which is bound.
 *
 * @param {WebGL2RenderingContext} gl
 * @param {GLenum} format
 * @param {{width: number, height: number}} size
 */
function newTexture(gl, format, { width, height }) {
  const texture = gl.createTexture();
  gl.bindTexture(gl.TEXTURE_2D, texture);
  gl.texStorage2D(gl.TEXTURE_2D, 1, format, width, height);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
  gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
  return texture;
}
