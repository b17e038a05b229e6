/** Numbered pins over the picture: buttons that follow it as it is zoomed and moved, and one pin that can be placed. */

import { h } from "../base/dom.js";
import { t } from "../base/words.js";

/** @typedef {import("./film-view.js").FilmView} FilmView */
/** A place as fractions of the picture's width and height. @typedef {{x: number, y: number}} Spot */
/** @typedef {Spot & {id: string, number: number, label: string, isDone: boolean}} NotePin */

const STEP = 0.01;
const FINE_STEP = 0.001;

/**
 * @param {FilmView} view
 * @param {import("../base/store.js").Disposer} life
 * @param {(id: string) => void} chosen called when a pin is clicked
 */
export function notePins(view, life, chosen) {
  const layer = h("div", { class: "note-pins" });
  view.element.append(layer);
  /** @type {{spot: Spot, element: HTMLElement}[]} */
  let placed = [];
  /** @type {{spot: Spot, element: HTMLElement} | null} */
  let draft = null;
  const place = () => {
    const { viewport, size } = view;
    const ratio = devicePixelRatio;
    const [pane] = view.over.panes();
    const edge = { x: viewport.canvas.width / ratio, y: viewport.canvas.height / ratio };
    for (const { spot, element } of draft ? [...placed, draft] : placed) {
      const x = (viewport.x + (pane?.shift ?? 0) + spot.x * size.width * viewport.scale) / ratio;
      const y = (viewport.y + spot.y * size.height * viewport.scale) / ratio;
      // Outside, focusing it would scroll the stage.
      element.hidden = x < 0 || y < 0 || x > edge.x || y > edge.y;
      element.style.translate = `${x}px ${y}px`;
    }
  };
  const mark = () => view.over.setMark("notes", placed.length || draft ? place : null);
  life.add(() => layer.remove());

  /** A pressed pin does not pan the picture. @param {HTMLElement} element */
  const still = (element) => {
    for (const type of ["pointerdown", "dblclick"]) element.addEventListener(type, (event) => event.stopPropagation());
    return element;
  };

  return {
    /** @param {NotePin[]} pins @param {string | null} current id of the chosen one */
    show(pins, current) {
      const focused = placed.findIndex(({ element }) => element === document.activeElement);
      for (const { element } of placed) element.remove();
      placed = pins.map(({ id, number, x, y, label, isDone }) => ({
        spot: { x, y },
        element: still(
          h(
            "button",
            { class: `note-pin${isDone ? " done" : ""}`, type: "button", "aria-label": label, "aria-pressed": String(id === current), title: label, onclick: () => chosen(id) },
            number,
          ),
        ),
      }));
      layer.append(...placed.map(({ element }) => element));
      mark();
      if (focused >= 0) placed[focused]?.element.focus({ preventScroll: true });
    },
    /**
     * Shows the pin of a note that is being written; arrow keys move it.
     *
     * @param {Spot | null} spot null: none
     * @param {(spot: Spot) => void} [moved]
     * @param {() => void} [done] called on Enter and Escape
     */
    setDraft(spot, moved = () => {}, done = () => {}) {
      draft?.element.remove();
      draft = null;
      if (spot) {
        const element = still(h("button", { class: "note-pin draft", type: "button", "aria-label": t("New note's pin: move it with the arrow keys"), onclick: () => done() }, "+"));
        const own = (draft = { spot, element });
        element.addEventListener("keydown", (event) => {
          const [dx, dy] = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] }[event.key] ?? [0, 0];
          if (event.key === "Escape") done();
          else if (!dx && !dy) return;
          event.preventDefault();
          event.stopPropagation();
          const by = event.shiftKey ? FINE_STEP : STEP;
          own.spot = { x: Math.min(Math.max(own.spot.x + (dx ?? 0) * by, 0), 1), y: Math.min(Math.max(own.spot.y + (dy ?? 0) * by, 0), 1) };
          place();
          moved(own.spot);
        });
        layer.append(element);
      }
      mark();
    },
    focusDraft: () => draft?.element.focus({ preventScroll: true }),
  };
}
