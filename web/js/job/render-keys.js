/** Keyboard shortcuts of the render view; same as tev's where tev has them. */

import { channels } from "../film/channels.js";
import { PARTS } from "../film/film-shader.js";
import { DENOISE_MODES, canDenoise } from "./denoise-fields.js";
import { EXPOSURE_STEP, clampExposure } from "./display-panel.js";
import { workers } from "../news/farm.js";
import { moreSamples, pauseOrResume } from "./job-panel.js";
import { here, linkTo } from "../shell/router.js";
import { announce } from "../shell/tray.js";
import { t } from "../base/words.js";

/** @typedef {import("../shell/shortcuts.js").Shortcut} Shortcut */

/** In a shot, the arrows change frames and vi's keys move the pixel cursor. */
const ARROWS = /** @type {const} */ ([
  ["ArrowLeft", "H", -1, 0],
  ["ArrowRight", "L", 1, 0],
  ["ArrowUp", "K", 0, -1],
  ["ArrowDown", "J", 0, 1],
]);

/**
 * Shortcuts of every stage: exposure, zoom, pixel cursor.
 *
 * @template {{exposure: number, curve: string}} T
 * @param {object} parts
 * @param {import("../film/film-view.js").FilmView | null} parts.view
 * @param {import("../base/store.js").Store<T>} parts.display
 * @param {() => void} parts.normalise
 * @param {number} [parts.usual] exposure that a reset sets, in stops
 * @param {boolean} [parts.inShot] the arrows go to other frames
 * @returns {Shortcut[]}
 */
export function stageKeys({ view, display, normalise, usual = 0, inShot = false }) {
  /** @param {number} exposure */
  const expose = (exposure) => {
    display.update((look) => ({ ...look, exposure: clampExposure(exposure) }));
    announce(t("Exposure {exposure} stops", { exposure: display.value.exposure }));
  };
  const inspect = ARROWS.flatMap(([arrow, letter, dx, dy]) =>
    [1, 10].map((by) => ({
      keys: `${by > 1 ? "Shift+" : ""}${inShot ? letter : arrow}`,
      shown: letter === "H" && by === 1 ? (inShot ? "H J K L" : t("Arrows")) : null, // one line of help for all eight
      does: t("Move the pixel cursor; with Shift, by ten"),
      run: () => view?.moveCursor(dx * by, dy * by),
    })),
  );
  return [
    { keys: "E", does: t("Half a stop brighter"), run: () => expose(display.value.exposure + EXPOSURE_STEP) },
    { keys: "Shift+E", does: t("Half a stop darker"), run: () => expose(display.value.exposure - EXPOSURE_STEP) },
    { keys: "R", does: t("Reset the exposure"), run: () => expose(usual) },
    { keys: "N", does: t("Fit exposure: the brightest just below white"), run: normalise },
    { keys: "F", does: t("Fit the picture"), run: () => view?.fit() },
    { keys: "1", does: t("One picture pixel per screen pixel"), run: () => view?.actualSize() },
    { keys: "+", does: t("Zoom in"), run: () => view?.zoom(1) },
    { keys: "-", does: t("Zoom out"), run: () => view?.zoom(-1) },
    ...inspect,
  ];
}

/**
 * Additional shortcuts of a job.
 *
 * @param {object} parts
 * @param {() => import("../base/types.js").Job} parts.job
 * @param {import("../base/store.js").Store<import("./display-panel.js").Display>} parts.display
 * @param {boolean} [parts.inShot] Space plays it
 * @returns {{picture: Shortcut[], view: Shortcut[]}}
 */
export function jobKeys({ job, display, inShot = false }) {
  const outline = () => display.update((look) => ({ ...look, outlines: !look.outlines }));
  const denoise = () => {
    if (!canDenoise(workers.value)) {
      announce(t("No connected worker can denoise"));
      return;
    }
    const next = DENOISE_MODES[(DENOISE_MODES.indexOf(display.value.denoise) + 1) % DENOISE_MODES.length] ?? "off";
    display.update((look) => ({ ...look, denoise: next }));
  };
  const compare = () => {
    const frame = inShot ? here().params.get("frame") : null;
    location.hash = linkTo("compare", job().id) + (frame ? `?frame=${frame}` : "");
  };
  /** @type {Shortcut[]} */
  const planes = channels().slice(0, 9).map(({ name, label }, i) => ({
    keys: `Shift+${i + 1}`,
    shown: i ? null : "Shift+1…9",
    does: t("Channels: colour, albedo, normal, depth and so on"),
    run: () => {
      display.update((look) => ({ ...look, channel: name }));
      announce(label);
    },
  }));
  /** @type {Shortcut[]} */
  const parts = PARTS.slice(1).map(({ name, hint }, i) => ({
    keys: String(i + 2),
    shown: i ? null : "2…6",
    does: t("Red, green, blue, luminance or false colour alone; again for all"),
    run: () => {
      const part = display.value.part === name ? "" : name;
      display.update((look) => ({ ...look, part }));
      announce(part ? hint : t("Colour"));
    },
  }));
  const picture = [
    {
      keys: "P",
      does: t("Pause or resume rendering"),
      get shown() {
        return job().state === "finished" ? null : "P";
      },
      run: () => pauseOrResume(job()),
    },
    { keys: "M", does: t("More samples"), run: () => moreSamples(job()) },
    { keys: "D", does: t("Denoise: off, split, on"), run: denoise },
    { keys: "C", does: t("Compare with another picture"), run: compare },
  ];
  return { picture, view: [...parts, ...planes, { keys: "T", does: t("Outline the tiles being rendered"), run: outline }] };
}
