/** Which workers rendered the samples of a picture: its tiles in the workers' colours, with a legend. */

import { getFrameWorkers } from "../news/api.js";
import { fill, h, setText } from "../base/dom.js";
import { percent } from "../base/format.js";
import { SANS } from "../film/pixel-overlay.js";
import { workerColours } from "../film/worker-colours.js";
import { here, setParams } from "../shell/router.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").FrameWorkers} FrameWorkers */
/** @typedef {{x: number, y: number, w: number, h: number, name: string | null}} Part a part of a tile; name: null if not recorded */

const RENEW_MS = 3000;
const UNKNOWN = "#9aa0a6";
const OPACITY = 0.45;

/**
 * Divides each tile among its workers, from left to right, by their number of samples.
 *
 * @param {FrameWorkers} found
 * @returns {Part[]}
 */
export function partsOfTiles({ workers, tiles }) {
  return tiles.flatMap(({ x, y, w, h, samples, shares }) => {
    const rest = samples - shares.reduce((sum, own) => sum + own, 0);
    const each = [...shares.map((own, i) => ({ own, name: workers[i]?.name ?? null })), { own: rest, name: null }];
    let left = x;
    return each.flatMap(({ own, name }) => {
      const width = (w * own) / samples;
      const part = { x: left, y, w: width, h, name };
      left += width;
      return own > 0 ? [part] : [];
    });
  });
}

/**
 * @param {() => Job} job
 * @param {import("../film/live-picture.js").LivePicture} picture
 * @param {import("../base/store.js").Disposer} life
 */
export function whoRendered(job, picture, life) {
  const { live, view } = picture;
  const check = h("input", { type: "checkbox", onchange: () => turn(check.checked) });
  const legend = h("ul", { class: "workers-legend", "aria-label": t("Workers that rendered it"), hidden: true });
  const said = h("p", { class: "quiet small", role: "status", hidden: true });
  const element = h("section", { class: "side-section stack tight", "aria-label": t("Workers") }, h("label", { class: "check" }, check, t("Who rendered it")), legend, said);
  check.checked = here().params.get("by") === "1";
  const abort = new AbortController();
  life.add(() => abort.abort());
  let shown = "";

  /** @param {FrameWorkers | null} found */
  const show = (found) => {
    shown = found ? JSON.stringify(found) : "";
    legend.hidden = !found;
    if (!found) {
      view?.over.setMark("workers", null);
      return;
    }
    const colours = workerColours(found.workers);
    const parts = partsOfTiles(found);
    view?.over.setMark("workers", (over, ratio) => draw(over, ratio, parts, colours));
    const total = found.workers.reduce((sum, { samples }) => sum + samples, found.unknown) || 1;
    const rows = [...found.workers.map(({ name, samples }) => ({ name, samples, colour: colours.get(name) ?? UNKNOWN })), ...(found.unknown ? [{ name: t("Not recorded"), samples: found.unknown, colour: UNKNOWN }] : [])];
    fill(
      legend,
      ...rows.map(({ name, samples, colour }) => {
        const swatch = h("span", { class: "swatch" });
        swatch.style.background = colour;
        return h("li", null, swatch, h("span", { class: "grow" }, name), h("span", { class: "quiet number" }, percent(samples / total)));
      }),
    );
  };
  const renew = async () => {
    if (!check.checked) return;
    const { frame } = live;
    try {
      const found = await getFrameWorkers({ job: job().id, frame }, abort.signal);
      if (!check.checked || frame !== live.frame) return;
      said.hidden = true;
      if (JSON.stringify(found) !== shown) show(found);
    } catch (error) {
      if (abort.signal.aborted) return;
      show(null);
      said.hidden = false;
      setText(said, /** @type {Error} */ (error).message);
    }
  };
  const turn = (/** @type {boolean} */ on) => {
    setParams({ by: on ? "1" : null });
    if (on) void renew();
    else show(null);
    if (!on) said.hidden = true;
  };
  life.add(live.onTurn(() => void renew()));
  life.every(RENEW_MS, () => job().state === "running" && void renew());
  let state = "";
  return {
    element,
    update: (/** @type {Job} */ next) => {
      check.disabled = next.samples === 0;
      if (next.state !== state && next.samples > 0) void renew();
      state = next.samples > 0 ? next.state : "";
    },
  };
}

/**
 * @param {import("../film/pixel-overlay.js").PixelOverlay} over
 * @param {number} ratio
 * @param {Part[]} parts
 * @param {Map<string, string>} colours
 */
function draw({ context, viewport }, ratio, parts, colours) {
  const { x: left, y: top, scale } = viewport;
  context.font = `600 ${11 * ratio}px ${SANS}`;
  for (const { x, y, w, h: height, name } of parts) {
    const box = /** @type {const} */ ([left + x * scale, top + y * scale, w * scale, height * scale]);
    context.globalAlpha = OPACITY;
    context.fillStyle = (name !== null && colours.get(name)) || UNKNOWN;
    context.fillRect(...box);
    context.globalAlpha = 1;
    const fits = name !== null && context.measureText(name).width < box[2] - 8 * ratio && box[3] > 18 * ratio;
    if (!fits) continue;
    context.strokeStyle = "rgb(0 0 0 / 0.75)";
    context.lineWidth = 3 * ratio;
    context.lineJoin = "round";
    context.strokeText(name, box[0] + 4 * ratio, box[1] + 13 * ratio);
    context.fillStyle = "#fff";
    context.fillText(name, box[0] + 4 * ratio, box[1] + 13 * ratio);
  }
}
