/**
 * The notebook widget's half in the browser: radiance in, what a screen shows out. The tone curve is `neutral` of
 * renderer/image/tonemap.py, and the words are those of renderer/image/rgbe9995.py.
 *
 * @typedef {{ get(name: string): any, set(name: string, value: any): void, save_changes(): void,
 *   on(event: string, f: () => void): void, off(event: string, f: () => void): void }} Model
 */

const STYLE = `
.rayfarm-shown { --line: color-mix(in srgb, currentColor 22%, transparent); max-width: 100%; font: 13px/1.5 system-ui, sans-serif; }
.rayfarm-shown canvas { display: block; width: 100%; background: #1b1c1f; border-radius: 6px; cursor: grab; touch-action: none;
  image-rendering: auto; }
.rayfarm-shown canvas.near { image-rendering: pixelated; }
.rayfarm-shown canvas:active { cursor: grabbing; }
.rayfarm-shown canvas:focus-visible { outline: 2px solid Highlight; outline-offset: 2px; }
.rayfarm-shown .bar { height: 3px; margin: 0 0 6px; border-radius: 2px; background: var(--line); overflow: hidden; }
.rayfarm-shown .bar i { display: block; height: 100%; background: #3b82c4; transition: width 0.2s; }
.rayfarm-shown .row { display: flex; flex-wrap: wrap; align-items: center; gap: 4px 14px; font-variant-numeric: tabular-nums; }
.rayfarm-shown label { display: inline-flex; align-items: center; gap: 8px; }
.rayfarm-shown input { width: 140px; }
.rayfarm-shown output { display: inline-block; min-width: 4.5em; }
.rayfarm-shown .grow { flex: 1 1 14em; }
.rayfarm-shown button { min-height: 26px; padding: 0 10px; border: 1px solid var(--line); border-radius: 5px; background: none;
  color: inherit; font: inherit; cursor: pointer; }
@media (prefers-reduced-motion: reduce) { .rayfarm-shown .bar i { transition: none; } }
`;
const MOST_ZOOM = 64;

/**
 * A word's three channels, scene-linear.
 * @param {number} word @param {Float32Array} into @param {number} at
 */
export function unpack(word, into, at) {
  const scale = 2 ** ((word >>> 27) - 24);
  into[at] = (word & 511) * scale;
  into[at + 1] = ((word >>> 9) & 511) * scale;
  into[at + 2] = ((word >>> 18) & 511) * scale;
}

/** Khronos PBR Neutral, then the sRGB encoding, of one pixel in place: 0..255. @param {Float32Array} c @param {number} gain */
export function shown(c, gain) {
  let r = Number(c[0]) * gain;
  let g = Number(c[1]) * gain;
  let b = Number(c[2]) * gain;
  const low = Math.min(r, g, b);
  const foot = low < 0.08 ? low - 6.25 * low * low : 0.04;
  r -= foot;
  g -= foot;
  b -= foot;
  const peak = Math.max(r, g, b);
  const start = 0.76;
  if (peak >= start) {
    const room = 1 - start;
    const top = 1 - (room * room) / (peak + room - start);
    const grey = 1 - 1 / (0.15 * (peak - top) + 1);
    const squeeze = top / peak;
    r = r * squeeze + (top - r * squeeze) * grey;
    g = g * squeeze + (top - g * squeeze) * grey;
    b = b * squeeze + (top - b * squeeze) * grey;
  }
  c[0] = encode(r);
  c[1] = encode(g);
  c[2] = encode(b);
}

/** @param {number} x */
function encode(x) {
  const c = Math.min(Math.max(x, 0), 1);
  return 255 * (c <= 0.0031308 ? 12.92 * c : 1.055 * c ** (1 / 2.4) - 0.055);
}

/** @param {{ model: Model, el: HTMLElement }} given */
function render({ model, el }) {
  const root = document.createElement("div");
  root.className = "rayfarm-shown";
  root.innerHTML = `<style>${STYLE}</style>
    <div class="bar" role="progressbar" aria-label="Samples" aria-valuemin="0" aria-valuemax="100"><i></i></div>
    <canvas tabindex="0" role="img" aria-label="The picture. Plus and minus zoom, arrows move, 0 fits."></canvas>
    <div class="row"><span class="grow status" role="status"></span><span class="pixel"></span>
      <label>Exposure <input type="range" min="-8" max="8" step="0.1"><output></output></label>
      <button type="button" class="fit">Fit</button></div>`;
  el.append(root);
  /** @param {string} query */
  const find = (query) => /** @type {any} */ (root.querySelector(query));
  /** @type {HTMLCanvasElement} */
  const canvas = find("canvas");
  const bar = find(".bar");
  const exposure = find("input");
  const whole = document.createElement("canvas");
  const view = { zoom: 1, x: 0.5, y: 0.5 }; // how much nearer than fitted, and what is in the middle, 0..1
  let words = new Uint32Array();
  let asked = 0;

  function read() {
    const data = model.get("pixels");
    const bytes = new Uint8Array(data.buffer ?? data, data.byteOffset ?? 0, data.byteLength);
    words = new Uint32Array(bytes.slice().buffer);
    develop();
  }

  function develop() {
    const [width, height] = [model.get("width"), model.get("height")];
    if (!width || words.length !== width * height) return;
    if (whole.width !== width || whole.height !== height) [whole.width, whole.height] = [width, height];
    const image = new ImageData(width, height);
    const pixel = new Float32Array(3);
    const gain = 2 ** model.get("exposure");
    for (let i = 0; i < words.length; i++) {
      unpack(Number(words[i]), pixel, 0);
      shown(pixel, gain);
      // The array rounds to the nearest.
      image.data[4 * i] = Number(pixel[0]);
      image.data[4 * i + 1] = Number(pixel[1]);
      image.data[4 * i + 2] = Number(pixel[2]);
      image.data[4 * i + 3] = 255;
    }
    whole.getContext("2d")?.putImageData(image, 0, 0);
    draw();
  }

  function draw() {
    if (asked) return;
    asked = requestAnimationFrame(() => {
      asked = 0;
      if (canvas.width !== whole.width || canvas.height !== whole.height) {
        [canvas.width, canvas.height] = [whole.width, whole.height];
        // As large as it is, unless that is tiny, and never higher than a window shows.
        const tall = `calc(75vh * ${whole.width / whole.height})`;
        root.style.width = `min(100%, max(480px, ${whole.width}px), ${tall})`;
      }
      const half = 0.5 / view.zoom;
      view.x = Math.min(Math.max(view.x, half), 1 - half);
      view.y = Math.min(Math.max(view.y, half), 1 - half);
      const context = canvas.getContext("2d");
      if (!context) return;
      context.imageSmoothingEnabled = view.zoom < 2;
      canvas.classList.toggle("near", view.zoom >= 2);
      const [w, h] = [whole.width / view.zoom, whole.height / view.zoom];
      const [x, y] = [(view.x - half) * whole.width, (view.y - half) * whole.height];
      context.drawImage(whole, x, y, w, h, 0, 0, canvas.width, canvas.height);
    });
  }

  function tell() {
    find(".status").textContent = model.get("status");
    const percent = Math.round(100 * model.get("progress"));
    find(".bar i").style.width = `${percent}%`;
    bar.setAttribute("aria-valuenow", String(percent));
    bar.style.visibility = model.get("is_over") ? "hidden" : "visible";
    exposure.value = String(model.get("exposure"));
    find("output").textContent = `${model.get("exposure") > 0 ? "+" : ""}${Number(model.get("exposure")).toFixed(1)} EV`;
  }

  /** Zoom so that what is at (fx, fy) of the canvas stays there. @param {number} by @param {number} fx @param {number} fy */
  function zoom(by, fx = 0.5, fy = 0.5) {
    const [x, y] = [view.x + (fx - 0.5) / view.zoom, view.y + (fy - 0.5) / view.zoom];
    view.zoom = Math.min(Math.max(view.zoom * by, 1), MOST_ZOOM);
    [view.x, view.y] = [x - (fx - 0.5) / view.zoom, y - (fy - 0.5) / view.zoom];
    draw();
  }

  /** Where the pointer is, 0..1 of the canvas. @param {MouseEvent} event @returns {[number, number]} */
  function at(event) {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
  }

  canvas.addEventListener(
    "wheel",
    (event) => {
      if (!event.ctrlKey && view.zoom === 1 && event.deltaY > 0) return; // the page scrolls on
      event.preventDefault();
      zoom(2 ** (-event.deltaY / 240), ...at(event));
    },
    { passive: false },
  );
  canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
  canvas.addEventListener("pointermove", (event) => {
    const [fx, fy] = at(event);
    if (event.buttons & 1) {
      const box = canvas.getBoundingClientRect();
      view.x -= event.movementX / box.width / view.zoom;
      view.y -= event.movementY / box.height / view.zoom;
      draw();
    }
    const x = Math.floor((view.x + (fx - 0.5) / view.zoom) * whole.width);
    const y = Math.floor((view.y + (fy - 0.5) / view.zoom) * whole.height);
    const word = words[y * whole.width + x];
    if (word === undefined || x < 0 || x >= whole.width) return;
    const values = new Float32Array(3);
    unpack(word, values, 0);
    find(".pixel").textContent = `${x}, ${y}: ${[...values].map((v) => v.toPrecision(3)).join(" ")}`;
  });
  canvas.addEventListener("pointerleave", () => (find(".pixel").textContent = ""));
  canvas.addEventListener("dblclick", () => fit());
  canvas.addEventListener("keydown", (event) => {
    const step = 0.1 / view.zoom;
    const moves = /** @type {Record<string, () => void>} */ ({
      "+": () => zoom(1.5),
      "=": () => zoom(1.5),
      "-": () => zoom(1 / 1.5),
      0: fit,
      ArrowLeft: () => (view.x -= step),
      ArrowRight: () => (view.x += step),
      ArrowUp: () => (view.y -= step),
      ArrowDown: () => (view.y += step),
    });
    const move = moves[event.key];
    if (!move || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation(); // a notebook has keys of its own
    move();
    draw();
  });
  function fit() {
    Object.assign(view, { zoom: 1, x: 0.5, y: 0.5 });
    draw();
  }
  find(".fit").addEventListener("click", fit);
  exposure.addEventListener("input", () => {
    model.set("exposure", Number(exposure.value));
    model.save_changes();
  });

  const told = /** @type {[string, () => void][]} */ ([
    ["change:pixels", read],
    ["change:exposure", () => (tell(), develop())],
    ["change:status", tell],
    ["change:progress", tell],
    ["change:is_over", tell],
  ]);
  for (const [event, f] of told) model.on(event, f);
  tell();
  read();
  return () => {
    for (const [event, f] of told) model.off(event, f);
  };
}

export default { render };
