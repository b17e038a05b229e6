/** The keys of the render view; tev's, where tev has them. */

import { EXPOSURE_STEP, clampExposure } from "./display-panel.js";
import { moreSamples, pauseOrResume } from "./job-panel.js";
import { announce } from "./tray.js";

/** @typedef {import("./shortcuts.js").Shortcut} Shortcut */

const ARROWS = /** @type {const} */ ([
  ["ArrowLeft", -1, 0],
  ["ArrowRight", 1, 0],
  ["ArrowUp", 0, -1],
  ["ArrowDown", 0, 1],
]);

/**
 * @param {object} parts
 * @param {() => import("./types.js").Job} parts.job
 * @param {import("./film-view.js").FilmView | null} parts.view
 * @param {import("./store.js").Store<import("./display-panel.js").Display>} parts.display
 * @param {() => void} parts.normalise
 * @returns {Shortcut[]}
 */
export function renderKeys({ job, view, display, normalise }) {
  /** @param {number} exposure */
  const expose = (exposure) => {
    display.update((look) => ({ ...look, exposure: clampExposure(exposure) }));
    announce(`Exposure ${display.value.exposure} stops`);
  };
  const outline = () => display.update((look) => ({ ...look, outlines: !look.outlines }));
  const inspect = ARROWS.flatMap(([key, dx, dy]) =>
    [1, 10].map((by) => ({
      keys: by > 1 ? `Shift+${key}` : key,
      shown: key === "ArrowLeft" && by === 1 ? "Arrows" : null, // one line for all eight
      does: "Read pixels by keys; with Shift ten at a time",
      run: () => view?.moveCursor(dx * by, dy * by),
    })),
  );
  return [
    { keys: "E", does: "Half a stop brighter", run: () => expose(display.value.exposure + EXPOSURE_STEP) },
    { keys: "Shift+E", does: "Half a stop darker", run: () => expose(display.value.exposure - EXPOSURE_STEP) },
    { keys: "R", does: "Reset the exposure", run: () => expose(0) },
    { keys: "N", does: "Normalise: the brightest below white", run: normalise },
    { keys: "F", does: "Fit the picture", run: () => view?.fit() },
    { keys: "1", does: "One picture pixel a screen pixel", run: () => view?.actualSize() },
    { keys: "+", does: "Zoom in", run: () => view?.zoom(1) },
    { keys: "-", does: "Zoom out", run: () => view?.zoom(-1) },
    ...inspect,
    { keys: "T", does: "Outline the tiles being rendered", run: outline },
    { keys: "Space", does: "Pause or resume", run: () => pauseOrResume(job()) },
    { keys: "M", does: "More samples", run: () => moreSamples(job()) },
  ];
}
