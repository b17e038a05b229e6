/** Measures how bright a preview mesh is, so that a new light is exposed before there are samples. */

import { brightnessOf } from "../film/brightness.js";
import { curveIndex } from "../film/film-shader.js";
import { DEFAULT_CURVE, undisplayed } from "../film/tonemap.js";

/** Range of the exposed radiance of the brightest tenth in which eight bits suffice; factor of the gain to reach it, and maximum number of such steps. */
const [LEAST, MOST, STEP, TRIES] = [0.02, 4, 16, 4];

/**
 * Returns the brightness of a preview mesh with its floor and backdrop, as Film.brightness does; null if it is black or cannot be drawn.
 *
 * @param {import("./mesh-canvas.js").MeshCanvas} mesh visible on the page
 */
export function meshBrightness(mesh) {
  const { gl, look } = mesh;
  if (!gl || gl.isContextLost()) return null;
  /** @param {number} gain */
  const measure = (gain) => {
    mesh.look = { gain, curve: curveIndex(DEFAULT_CURVE) };
    mesh.draw();
    const { drawingBufferWidth: width, drawingBufferHeight: height } = gl; // WebGL keeps its picture only until the next frame
    const bytes = new Uint8Array(4 * width * height);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, bytes);
    return brightnessOf(width * height, (i) => {
      if (bytes[4 * i + 3] !== 255) return null;
      const [r, g, b] = undisplayed([bytes[4 * i] ?? 0, bytes[4 * i + 1] ?? 0, bytes[4 * i + 2] ?? 0]);
      return [r / gain, g / gain, b / gain];
    });
  };
  let { gain } = look;
  let found = measure(gain);
  for (let i = 0; i < TRIES && found.high > 0 && !(found.high * gain >= LEAST && found.high * gain <= MOST); i++) {
    gain *= found.high * gain < LEAST ? STEP : 1 / STEP;
    found = measure(gain);
  }
  const isAsShown = mesh.look.gain === look.gain && mesh.look.curve === look.curve;
  mesh.look = look;
  if (!isAsShown) mesh.invalidate();
  return found.high > 0 ? found : null;
}
