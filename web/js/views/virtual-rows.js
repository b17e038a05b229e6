/** A virtual list of very many rows of equal height, of which only those near the screen exist in the DOM. */

import { focusRow, h, keyedList } from "../base/dom.js";

/** Additional rows above and below the screen, so that scrolling shows them at once. */
const ROWS_BEYOND_SCREEN = 6;

/**
 * @typedef {object} VirtualRows
 * @property {HTMLElement} element its rows' height is --row, their columns are --columns
 * @property {(ids: string[]) => void} show
 * @property {(at: number) => void} focus brings a row to the screen, and the focus to its link
 */

/**
 * @param {(id: string) => import("../base/dom.js").Row<string>} create
 * @param {import("../base/store.js").Disposer} life
 * @returns {VirtualRows}
 */
export function virtualRows(create, life) {
  const probe = h("div", { class: "row-probe", "aria-hidden": "true" });
  const list = h("ul", { class: "rows", role: "list" });
  const element = h("div", { class: "virtual-rows" }, probe, list);
  /** @type {string[]} */
  let ids = [];
  /** @type {Map<string, number>} */
  const places = new Map();
  let frame = 0;

  const fillRows = keyedList(
    list,
    (/** @type {string} */ id) => id,
    (id) => {
      const row = create(id);
      return {
        element: row.element,
        update(same) {
          const at = places.get(same) ?? 0;
          const { columns, height } = shape();
          row.element.style.top = `${Math.floor(at / columns) * height}px`;
          row.element.style.left = `${((at % columns) * 100) / columns}%`;
          row.element.style.width = `${100 / columns}%`;
          row.element.setAttribute("aria-setsize", String(ids.length));
          row.element.setAttribute("aria-posinset", String(at + 1));
          row.update(same);
        },
      };
    },
  );

  const shape = () => ({
    columns: Math.max(1, Number(getComputedStyle(probe).getPropertyValue("--columns")) || 1),
    height: probe.offsetHeight || 72,
  });

  const draw = () => {
    frame = 0;
    const { columns, height } = shape();
    list.style.height = `${Math.ceil(ids.length / columns) * height}px`;
    const top = -list.getBoundingClientRect().top;
    const first = Math.max(0, Math.floor(top / height) - ROWS_BEYOND_SCREEN) * columns;
    const last = (Math.ceil((top + innerHeight) / height) + ROWS_BEYOND_SCREEN) * columns;
    const near = ids.slice(first, Math.max(first, last));
    places.clear();
    near.forEach((id, i) => places.set(id, first + i));
    fillRows(near);
  };
  const soon = () => {
    frame ||= requestAnimationFrame(draw);
  };
  life.listen(window, "scroll", soon, { passive: true });
  life.listen(window, "resize", soon);
  life.add(() => cancelAnimationFrame(frame));

  return {
    element,
    show(next) {
      ids = next;
      // Elements have no height before the page is shown.
      if (element.isConnected) draw();
      else soon();
    },
    focus(at) {
      const id = ids[at];
      if (id === undefined) return;
      const { columns, height } = shape();
      const y = list.getBoundingClientRect().top + Math.floor(at / columns) * height;
      const margin = 2 * height; // height of the sticky header
      if (y < margin) scrollBy(0, y - margin);
      else if (y + height > innerHeight) scrollBy(0, y + height - innerHeight);
      draw();
      const row = [...list.children].find((child) => child.getAttribute("aria-posinset") === String(at + 1));
      focusRow(row);
    },
  };
}
