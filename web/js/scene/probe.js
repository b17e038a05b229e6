/** Finds out whether a black live view is of nothing, or of surfaces that no light reaches, by picking points of a grid. */

/** @typedef {import("./view-link.js").Picked} Picked */

/** Columns and rows of the grid. */
const [COLUMNS, ROWS] = [7, 5];
/** Time, in milliseconds, after which an unanswered point is picked again: the farm keeps only the latest pick. */
const AGAIN_MS = 2000;

/** @param {{width: number, height: number}} size of the view, in pixels @returns {[number, number][]} the middle first, then the others */
export function gridOf({ width, height }) {
  const points = Array.from({ length: COLUMNS * ROWS }, (_, i) => /** @type {[number, number]} */ ([Math.floor(((i % COLUMNS) + 0.5) * (width / COLUMNS)), Math.floor((Math.floor(i / COLUMNS) + 0.5) * (height / ROWS))]));
  const away = (/** @type {[number, number]} */ [x, y]) => Math.hypot(x / width - 0.5, y / height - 0.5);
  return points.sort((a, b) => away(a) - away(b));
}

/**
 * Picks the points one after another, until one is on a surface.
 *
 * @param {(at: [number, number]) => void} pick
 * @returns {{begin: (size: {width: number, height: number}, then: (seesSomething: boolean) => void) => void, take: (picked: Picked) => void, end: () => void}}
 */
export function probe(pick) {
  /** @type {[number, number][]} */
  let points = [];
  /** @type {(seesSomething: boolean) => void} */
  let done = () => {};
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const end = () => {
    clearTimeout(timer);
    points = [];
  };
  const ask = () => {
    const [point] = points;
    clearTimeout(timer);
    if (!point) return;
    pick(point);
    timer = setTimeout(ask, AGAIN_MS);
  };
  return {
    begin(size, then) {
      points = gridOf(size);
      done = then;
      ask();
    },
    take({ x, y, depth }) {
      if (points[0]?.[0] !== x || points[0][1] !== y) return; // a pick of the user's
      points.shift();
      if (!depth && points.length) return ask();
      end();
      done(Boolean(depth));
    },
    end,
  };
}
