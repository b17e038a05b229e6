/** Mouse, pen, touch and trackpad input on the canvas: dragging pans, the wheel zooms at the cursor, two fingers pinch. */

/** @typedef {import("./viewport.js").Viewport} Viewport */

/**
 * @param {HTMLElement} surface that takes the pointer
 * @param {(event: MouseEvent) => {x: number, y: number}} place of an event on the canvas, in device pixels
 * @param {Viewport} viewport
 * @param {() => void} changed
 * @returns {() => void} undoes it
 */
export function panAndZoom(surface, place, viewport, changed) {
  /** Pressed pointers with their latest positions. @type {Map<number, {x: number, y: number}>} */
  const down = new Map();
  const abort = new AbortController();
  const signal = abort.signal;

  surface.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const unit =
        event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : event.deltaMode === WheelEvent.DOM_DELTA_PAGE ? 400 : 1;
      // A mouse wheel's notch is 100 or 120, a quarter octave. A trackpad's pinch arrives as small deltas with Ctrl.
      const factor = 2 ** (-event.deltaY * unit * (event.ctrlKey ? 0.01 : 0.0025));
      const { x, y } = place(event);
      viewport.zoomTo(viewport.scale * factor, x, y);
      changed();
    },
    { passive: false, signal },
  );

  surface.addEventListener(
    "pointerdown",
    (event) => {
      if (event.button > 1) return;
      surface.setPointerCapture(event.pointerId);
      down.set(event.pointerId, place(event));
      surface.classList.add("dragging");
    },
    { signal },
  );

  surface.addEventListener(
    "pointermove",
    (event) => {
      const before = down.get(event.pointerId);
      if (!before) return;
      const now = place(event);
      if (down.size === 1) {
        viewport.pan(now.x - before.x, now.y - before.y);
      } else {
        const other = [...down].find(([id]) => id !== event.pointerId)?.[1] ?? now;
        const grown = distance(now, other) / Math.max(1, distance(before, other));
        viewport.zoomTo(viewport.scale * grown, (now.x + other.x) / 2, (now.y + other.y) / 2);
        viewport.pan((now.x - before.x) / 2, (now.y - before.y) / 2);
      }
      down.set(event.pointerId, now);
      changed();
    },
    { signal },
  );

  for (const type of /** @type {const} */ (["pointerup", "pointercancel"])) {
    surface.addEventListener(
      type,
      (event) => {
        down.delete(event.pointerId);
        if (down.size === 0) surface.classList.remove("dragging");
      },
      { signal },
    );
  }
  return () => abort.abort();
}

/**
 * @param {{x: number, y: number}} a
 * @param {{x: number, y: number}} b
 */
function distance(a, b) {
  return Math.hypot(a.x - b.x, a.y - b.y);
}
