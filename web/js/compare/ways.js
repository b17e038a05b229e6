/** Modes of a comparison: wipe, flicker, side by side, and difference maps. */

import { heatBar } from "../job/part-fields.js";
import { fill, h, setText } from "../base/dom.js";
import { segments } from "../forms/fields.js";
import { t } from "../base/words.js";

/** @typedef {import("./errors.js").ErrorKind} ErrorKind */
/** @typedef {import("./errors.js").Errors} Errors */
/** @typedef {import("../views/compare.js").Comparison} Comparison */

export const WAYS = /** @type {const} */ ([
  { name: "wipe", label: t("Wipe"), hint: t("A left of the divider, B right of it") },
  { name: "turns", label: t("Flicker"), hint: t("A and B take turns; hold B to see the other at any time") },
  { name: "side", label: t("Side"), hint: t("Side by side, at the same place and zoom") },
  { name: "difference", label: t("Difference"), hint: t("Root of the mean squared difference of R, G and B") },
  { name: "relative", label: t("Relative"), hint: t("Squared difference over A's square and 0.01") },
  { name: "flip", label: "FLIP", hint: t("Perceived difference when the two alternate, 0 to 1") },
]);

/** @typedef {(typeof WAYS)[number]["name"]} Way */

/** @param {string | null} text of the URL @returns {Way} */
export const wayFrom = (text) => WAYS.find(({ name }) => name === text)?.name ?? "wipe";

/** Returns the kind of map of a mode. @param {Way} way @returns {ErrorKind | null} */
export const mapOf = (way) => (way === "difference" || way === "relative" || way === "flip" ? way : null);

const TURN_MS = 600;
const RENEW_MS = 3000;

/** @param {number} value */
const figure = (value) => (value === 0 ? "0" : value.toPrecision(4));

/**
 * @param {object} parts
 * @param {import("../film/picture-stage.js").PictureStage} parts.stage
 * @param {import("../base/store.js").Store<Comparison>} parts.state
 * @param {() => boolean} parts.differInSize
 * @param {import("../base/store.js").Disposer} parts.life
 */
export function compareWays({ stage, state, differInSize, life }) {
  const { view } = stage;
  const choice = segments(
    t("Compare by"),
    WAYS.map(({ name, label }) => ({ value: name, label })),
    (way) => state.update((now) => ({ ...now, way: /** @type {Way} */ (way) })),
  );
  choice.element.querySelectorAll("label").forEach((label, i) => (label.title = WAYS[i]?.hint ?? ""));
  const hint = h("p", { class: "quiet small" });
  const bar = h("div", { hidden: true });
  const values = h("dl", { class: "figures number", hidden: true });
  const said = h("p", { class: "quiet small", role: "status", hidden: true });
  const shownTag = h("div", { class: "channel-tag alone turn-tag", role: "status", hidden: true });
  stage.element.append(shownTag);

  // Whether flicker shows B: by the clock, or while a key is held.
  let isOther = false;
  let isHeld = false;
  const turn = () => {
    const { way, wipe } = state.value;
    const alone = way === "turns" || isHeld;
    if (!alone || mapOf(way)) {
      shownTag.hidden = true;
      if (way === "wipe") view?.setWipe(wipe);
      return;
    }
    const second = isHeld ? way === "wipe" || !isOther : isOther;
    view?.setSideBySide(false);
    view?.setWipe(second ? 0 : 1);
    setText(shownTag, second ? "B" : "A");
    shownTag.hidden = false;
  };
  life.every(TURN_MS, () => {
    if (state.value.way !== "turns" || isHeld) return;
    isOther = !isOther;
    turn();
  });
  const hold = (/** @type {boolean} */ on) => (/** @type {KeyboardEvent} */ event) => {
    const isTyped = event.target instanceof HTMLElement && event.target.matches("input:not([type=radio]), select, textarea");
    if (event.key.toLowerCase() !== "b" || event.ctrlKey || event.metaKey || (on && (event.repeat || isTyped))) return;
    if (isHeld === on) return;
    isHeld = on;
    if (!on) view?.setSideBySide(state.value.way === "side");
    turn();
  };
  life.listen(window, "keydown", hold(true));
  life.listen(window, "keyup", hold(false));

  /** @type {Worker | null} */
  let worker = null;
  life.add(() => worker?.terminate());
  let isMeasuring = false;
  let isStale = false;
  let measuredAt = -Infinity;
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let waiting;
  life.add(() => clearTimeout(waiting));
  const ofDifferentSizes = () => {
    view?.setCover(null);
    bar.hidden = values.hidden = true;
    said.hidden = false;
    setText(said, t("The pictures differ in size, so their difference cannot be measured."));
  };
  const measure = () => {
    waiting = undefined;
    const kind = mapOf(state.value.way);
    if (!view || !kind || isMeasuring) return;
    const [a, b] = view.layers;
    if (differInSize()) return ofDifferentSizes();
    if ([a, b].some((layer) => !layer.image && layer.film?.isBlank !== false)) {
      said.hidden = false;
      setText(said, t("Waiting for both pictures."));
      return;
    }
    const [shownA, shownB] = [view.canvas.pixelsOf(a), view.canvas.pixelsOf(b)];
    if (!shownA || !shownB || !a.size) {
      said.hidden = false;
      setText(said, t("Waiting for both pictures."));
      return;
    }
    isMeasuring = true;
    isStale = false;
    said.hidden = false;
    setText(said, t("Measuring …"));
    const words = [a, b].map((layer) => (layer.image ? null : (layer.film?.words.slice() ?? null)));
    worker ??= new Worker(new URL("./errors-worker.js", import.meta.url), { type: "module" });
    worker.onmessage = (/** @type {MessageEvent<Errors>} */ { data }) => void show(data, kind);
    worker.onerror = () => {
      isMeasuring = false;
      setText(said, t("The difference could not be measured in this browser."));
    };
    const { width, height } = a.size;
    worker.postMessage({ width, height, wordsA: words[0], wordsB: words[1], shownA, shownB, kind }, [shownA.buffer, shownB.buffer]);
  };
  /** @param {Errors} errors @param {ErrorKind} kind */
  const show = async ({ mse, relMse, flip, map, high }, kind) => {
    isMeasuring = false;
    measuredAt = performance.now();
    if (mapOf(state.value.way) !== kind || !view) return soon();
    const { width = 1, height = 1 } = view.layers[0].size ?? {};
    const options = /** @type {const} */ ({ colorSpaceConversion: "none", premultiplyAlpha: "none" });
    if (map.length !== 4 * width * height) return soon();
    const image = await createImageBitmap(new ImageData(map, width, height), options);
    if (mapOf(state.value.way) !== kind) return image.close();
    view.setCover(image);
    const name = WAYS.find((way) => way.name === kind)?.hint ?? "";
    bar.hidden = values.hidden = false;
    fill(bar, heatBar(name, 0, high));
    const figures = [
      ["MSE", mse],
      ["relMSE", relMse],
      ["FLIP", flip],
    ];
    fill(values, ...figures.map(([label, value]) => h("div", null, h("dt", null, String(label)), h("dd", null, figure(Number(value))))));
    const isPlane = view.layers.some((layer) => layer.image);
    setText(said, isPlane ? t("Computed on the planes as displayed, 0 to 1. A is the reference.") : t("Computed on linear values; FLIP on displayed values. A is the reference."));
    if (isStale) soon();
  };
  const soon = () => {
    isStale = true;
    if (!mapOf(state.value.way) || isMeasuring || waiting !== undefined) return;
    waiting = setTimeout(measure, Math.max(50, RENEW_MS - (performance.now() - measuredAt)));
  };
  const now = () => {
    clearTimeout(waiting);
    waiting = undefined;
    measuredAt = -Infinity;
    soon();
  };
  /** @param {import("../film/picture-side.js").FilmSource} live @returns {() => void} ends it */
  const listen = (live) => {
    const ends = [live.onTile(soon), live.onFill(now), live.onTurn(now)];
    return () => ends.forEach((end) => end());
  };
  let asked = "";
  life.add(
    state.subscribe(({ way, left, right, atA, atB, exposure, isCommon, curve }) => {
      choice.select(way);
      setText(hint, WAYS.find(({ name }) => name === way)?.hint ?? "");
      view?.setSideBySide(way === "side");
      stage.element.dataset.way = way;
      const map = mapOf(way);
      if (!map) {
        view?.setCover(null);
        bar.hidden = values.hidden = said.hidden = true;
      }
      turn();
      const key = JSON.stringify([map, left, right, atA, atB, exposure, isCommon, curve]);
      if (key !== asked) now();
      asked = key;
    }),
  );
  return {
    element: h("section", { class: "side-section stack tight", "aria-label": t("Ways to compare") }, choice.element, hint, bar, values, said),
    /** A side's picture has been loaded. */
    changed: now,
    /** Measurements change with this film. */
    listen,
    /** @type {import("../shell/shortcuts.js").Shortcut[]} */
    keys: [
      ...WAYS.map(({ name, hint: does }, i) => ({ keys: `Shift+${i + 1}`, does, run: () => state.update((was) => ({ ...was, way: name })) })),
      { keys: "B", does: t("Hold: the other picture"), run: () => {} },
    ],
  };
}
