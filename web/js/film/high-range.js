/**
 * Pictures of high dynamic range: a WebGPU canvas of half floats, whose values above 1 the display shows brighter than white. The
 * film's own shader draws them with WebGL into a texture of half floats, so that there is one shader for both ranges.
 */

/** Whether this display shows more than standard range, and this browser has what that takes. */
export const mayHaveHighRange = () => "gpu" in navigator && matchMedia("(dynamic-range: high)").matches;

export class HighRange {
  /**
   * @param {HTMLCanvasElement} canvas placed over the WebGL canvas, with the same size
   * @param {any} device GPUDevice
   */
  constructor(canvas, device) {
    this.canvas = canvas;
    this.device = device;
    this.context = /** @type {any} */ (canvas.getContext(/** @type {any} */ ("webgpu")));
    const usage = 0x02 | 0x10; // GPUTextureUsage.COPY_DST, RENDER_ATTACHMENT
    this.context.configure({ device, format: "rgba16float", usage, alphaMode: "premultiplied", toneMapping: { mode: "extended" } });
    /** @type {WebGLTexture | null} */
    this.texture = null;
    /** @type {WebGLFramebuffer | null} */
    this.frame = null;
    this.size = "";
    this.halves = new Uint16Array(0);
  }

  /**
   * Redirects drawing to the texture of half floats.
   *
   * @param {WebGL2RenderingContext} gl
   * @param {number} width
   * @param {number} height
   * @returns {boolean} false: WebGL cannot draw or read half floats here
   */
  begin(gl, width, height) {
    const size = `${width} ${height}`;
    if (size !== this.size) {
      if (!gl.getExtension("EXT_color_buffer_half_float") && !gl.getExtension("EXT_color_buffer_float")) return false;
      this.clear(gl);
      this.size = size;
      this.texture = gl.createTexture();
      gl.bindTexture(gl.TEXTURE_2D, this.texture);
      gl.texStorage2D(gl.TEXTURE_2D, 1, gl.RGBA16F, width, height);
      this.frame = gl.createFramebuffer();
      gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
      gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.TEXTURE_2D, this.texture, 0);
      this.halves = new Uint16Array(4 * width * height);
      const isReadable =
        gl.checkFramebufferStatus(gl.FRAMEBUFFER) === gl.FRAMEBUFFER_COMPLETE && gl.getParameter(gl.IMPLEMENTATION_COLOR_READ_TYPE) === gl.HALF_FLOAT;
      if (!isReadable) {
        this.clear(gl);
        return false;
      }
    }
    gl.bindFramebuffer(gl.FRAMEBUFFER, this.frame);
    return true;
  }

  /** Shows what was drawn since `begin`, whose first row is the upper one. @param {WebGL2RenderingContext} gl */
  end(gl) {
    const [width = 0, height = 0] = this.size.split(" ").map(Number);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.HALF_FLOAT, this.halves);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    this.device.queue.writeTexture({ texture: this.context.getCurrentTexture() }, this.halves, { bytesPerRow: 8 * width }, [width, height]);
  }

  /** @param {WebGL2RenderingContext} gl */
  clear(gl) {
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(this.frame);
    gl.deleteTexture(this.texture);
    this.frame = this.texture = null;
    this.size = "";
  }

  /** @param {WebGL2RenderingContext} gl */
  dispose(gl) {
    this.clear(gl);
    this.device.destroy();
    this.canvas.remove();
  }
}

/**
 * @param {HTMLCanvasElement} canvas
 * @returns {Promise<HighRange | null>} null: this browser has no WebGPU, or none for this machine
 */
export async function highRangeOn(canvas) {
  try {
    const adapter = await /** @type {any} */ (navigator).gpu?.requestAdapter();
    return adapter ? new HighRange(canvas, await adapter.requestDevice()) : null;
  } catch {
    return null;
  }
}
