/** Drawing a rectangle on the picture by dragging. */

/** @typedef {{x: number, y: number, w: number, h: number}} Rect in pixels of the picture */
/** @typedef {import("./film-view.js").FilmView} FilmView */

/** CSS pixels below which a drag is a click. */
const CLICK = 4;

/**
 * @param {FilmView} view
 * @param {{wanted: (event: PointerEvent) => boolean, chosen: (rect: Rect) => void}} handlers wanted: else the drag pans. A click is a
 *   rectangle of one pixel
 * @returns {() => void} ends it
 */
export function drawsRegions(view, { wanted, chosen }) {
  const abort = new AbortController();
  const { signal } = abort;
  const surface = view.element;
  /** @type {{pointer: number, from: {x: number, y: number}, to: {x: number, y: number}} | null} */
  let drag = null;

  const rect = () => {
    if (!drag) return null;
    const { width, height } = view.size;
    const [a, b] = [drag.from, drag.to].map(({ x, y }) => view.viewport.pixelAt(x, y));
    const inside = (/** @type {number} */ v, /** @type {number} */ most) => Math.min(Math.max(v, 0), most);
    const [left, right] = [a?.x ?? 0, b?.x ?? 0].sort((p, q) => p - q).map((v) => inside(v, width - 1));
    const [top, bottom] = [a?.y ?? 0, b?.y ?? 0].sort((p, q) => p - q).map((v) => inside(v, height - 1));
    return { x: left ?? 0, y: top ?? 0, w: (right ?? 0) - (left ?? 0) + 1, h: (bottom ?? 0) - (top ?? 0) + 1 };
  };
  const isClick = () =>
    drag !== null && Math.hypot(drag.to.x - drag.from.x, drag.to.y - drag.from.y) < CLICK * devicePixelRatio;
  const show = () => {
    const now = isClick() ? null : rect();
    view.over.setMark("region", now && ((over) => over.strokeTwice(now.x, now.y, now.w, now.h, { dash: true })));
  };
  const end = () => {
    drag = null;
    show();
  };

  // Before the stage handles it as panning.
  surface.addEventListener(
    "pointerdown",
    (event) => {
      const isOnPicture = event.target instanceof HTMLCanvasElement;
      if (drag || event.button !== 0 || !isOnPicture || !wanted(event)) return;
      event.stopImmediatePropagation();
      event.preventDefault();
      surface.setPointerCapture(event.pointerId);
      const at = view.place(event);
      drag = { pointer: event.pointerId, from: at, to: at };
    },
    { signal, capture: true },
  );
  surface.addEventListener(
    "pointermove",
    (event) => {
      if (drag?.pointer !== event.pointerId) return;
      event.stopImmediatePropagation();
      drag.to = view.place(event);
      show();
    },
    { signal, capture: true },
  );
  surface.addEventListener(
    "pointerup",
    (event) => {
      if (drag?.pointer !== event.pointerId) return;
      event.stopImmediatePropagation();
      drag.to = view.place(event);
      const { width, height } = view.size;
      const { x, y } = view.viewport.pixelAt(drag.from.x, drag.from.y);
      const isBeside = x < 0 || y < 0 || x >= width || y >= height;
      const found = isClick() ? (isBeside ? null : { x, y, w: 1, h: 1 }) : rect();
      end();
      if (found) chosen(found);
    },
    { signal, capture: true },
  );
  surface.addEventListener("pointercancel", end, { signal });
  return () => {
    abort.abort();
    view.over.setMark("region", null);
  };
}
