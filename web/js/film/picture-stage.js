/** The stage of one picture, or of two at a wipe: canvas, divider, names of the sides, pixel values, zoom. */

import { channelOf } from "./channels.js";
import { h, setText } from "../base/dom.js";
import { CannotShow } from "./film-canvas.js";
import { FilmView } from "./film-view.js";
import { emptyState } from "../shell/hints.js";
import { PictureSide } from "./picture-side.js";
import { PixelReadout } from "./pixel-readout.js";
import { rememberPlace } from "./view-place.js";
import { wipeDivider } from "./wipe.js";
import { zoomControls } from "./zoom-controls.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("./picture-side.js").FilmSource} FilmSource */

/**
 * @typedef {object} Side
 * @property {FilmSource} live
 * @property {string} channel
 * @property {readonly import("./light-mix.js").Strip[]} [mix] of the channels MIX and DENOISED_MIX
 * @property {string} [name] what it is called beside the other; its channel's where left out
 */

/**
 * @typedef {object} Arrangement
 * @property {Side} left
 * @property {Side | null} right
 * @property {number | null} wipe how much of the width is the left one's; null: the right one is shown alone
 */

/**
 * @typedef {object} PictureStage
 * @property {HTMLElement} element
 * @property {HTMLElement} statusBar
 * @property {HTMLElement} tools room in it
 * @property {FilmView | null} view null where this browser cannot show a film
 * @property {(arrangement: Arrangement) => void} arrange
 * @property {(which: 0 | 1) => PictureSide | null} side
 */

/**
 * @param {{width: number, height: number}} size of the left picture
 * @param {import("../base/store.js").Disposer} life
 * @param {{wiped: (fraction: number) => void, changed: () => void}} handlers changed: a side has begun or finished fetching its picture, or failed
 * @returns {PictureStage}
 */
export function pictureStage({ width, height }, life, { wiped, changed }) {
  /** @type {import("./film-view.js").FilmHandlers["cursor"]} */
  let pointed = () => {};
  let moved = () => {};
  const made = filmView(width, height, { cursor: (at, byKeys) => pointed(at, byKeys), moved: () => moved() });
  const view = made instanceof FilmView ? made : null;
  const zoom = zoomControls(() => view);
  const divider = wipeDivider(wiped);
  const tags = ["left", "right"].map((edge) =>
    h("div", { class: `channel-tag ${edge}`, role: "status", hidden: true }),
  );
  const readouts = h("div", { class: "readouts" });
  const tools = h("span", { class: "tools" });
  const element = h(
    "div",
    { class: "stage-box" },
    made instanceof FilmView ? made.element : filmErrorView(made),
    tags,
  );
  divider.element.hidden = true;
  element.style.setProperty("--aspect", `${width} / ${height}`);
  const statusBar = h(
    "footer",
    { class: "status-bar" },
    readouts,
    tools,
    h("span", { class: "quiet number size" }, `${width}×${height}`),
    zoom.element,
  );

  /** @type {[Part | null, Part | null]} */
  const parts = [null, null];
  if (view) {
    view.element.append(divider.element); // inside the stage, so that the wheel zooms over it too
    const remember = rememberPlace(view.viewport, life);
    moved = () => {
      zoom.show(view.viewport.scale);
      const { beside, above } = view.viewport.margins();
      element.style.setProperty("--beside", `${beside / devicePixelRatio}px`);
      element.style.setProperty("--above", `${above / devicePixelRatio}px`);
      remember();
    };
    pointed = (at, byKeys) => {
      for (const part of parts) part?.readout.point(at && within(part.side.live.film, at, width), byKeys);
    };
    life.add(() => {
      for (const part of parts) part?.dispose();
      view.dispose();
    });
  }

  /** @type {Arrangement | null} */
  let shown = null;
  const label = () => {
    if (!shown) return;
    const { left, right, wipe } = shown;
    const seen = [right === null || wipe !== null, right !== null];
    const both = seen.every(Boolean);
    for (const i of /** @type {const} */ ([0, 1])) {
      const side = parts[i]?.side;
      const { channel = "", waiting = false, isImproved = false, isPreview = false, error = null } = side?.state.value ?? {};
      const given = (i ? right : left)?.name;
      const name = given ?? channelOf(channel).label;
      const tag = /** @type {HTMLElement} */ (tags[i]);
      const spp = side?.previewSpp() ?? null;
      if (side?.showsEarlier()) setText(tag, t("Earlier picture, until this one is as clear"));
      else if (side?.showsRawMix()) setText(tag, waiting && side.live.finished ? t("Light mix, denoising …") : `${t("Light mix")}${waiting ? " …" : ""}`);
      else if (side?.showsStart()) setText(tag, t("Preview"));
      else if (side?.showsNoise() && side.toldSpp && !given && !error) setText(tag, tn(side.toldSpp, "{n} sample, not denoised yet", "{n} samples, not denoised yet"));
      else if (side?.awaitsDenoised() && !given) setText(tag, waiting ? t("Denoising …") : t("Raw"));
      else if (spp !== null && !given) setText(tag, name); // the heading counts the film's samples, of which the picture has fewer
      else setText(tag, `${name}${(waiting && !isImproved) || isPreview || side?.awaitsDenoised() ? " …" : ""}`);
      tag.hidden = !seen[i] || (!both && (channel === "" || side?.isEmpty() === true));
      tag.classList.toggle("alone", !both);
      parts[i]?.readout.setName(both ? name : "");
      if (parts[i]) parts[i].readout.element.hidden = !seen[i];
    }
    divider.element.hidden = !both;
    divider.set(wipe ?? 0, tags[0]?.textContent ?? "", tags[1]?.textContent ?? "");
    changed();
  };

  /** @param {Arrangement} next */
  const arrange = (next) => {
    if (!view) return;
    shown = next;
    for (const i of /** @type {const} */ ([0, 1])) {
      const wanted = i ? next.right : next.left;
      if (parts[i] && wanted?.live !== parts[i].side.live) {
        parts[i].dispose();
        parts[i] = null;
      }
      if (wanted && !parts[i]) {
        parts[i] = makePart(wanted.live, view.layers[i], label);
        readouts.append(parts[i].readout.element);
      }
      if (wanted) parts[i]?.side.choose(wanted.channel, wanted.mix);
    }
    view.setWipe(next.right ? (next.wipe ?? 0) : 1);
    label();
  };
  return { element, statusBar, tools, view, arrange, side: (which) => parts[which]?.side ?? null };
}

/** @typedef {{side: PictureSide, readout: PixelReadout, dispose: () => void}} Part */

/**
 * @param {FilmSource} live
 * @param {import("./film-layer.js").FilmLayer} layer
 * @param {() => void} changed
 * @returns {Part}
 */
function makePart(live, layer, changed) {
  const side = new PictureSide(live, layer);
  const readout = new PixelReadout(side);
  const unlisten = side.state.subscribe(changed);
  return {
    side,
    readout,
    dispose() {
      unlisten();
      readout.dispose();
      side.dispose();
    },
  };
}

/**
 * Returns the pixel of a film shown at another film's width that corresponds to that film's pixel; null if there is none.
 *
 * @param {import("./film.js").Film} film
 * @param {{x: number, y: number}} at
 * @param {number} width
 */
function within(film, at, width) {
  const scale = film.width / width;
  const x = Math.floor((at.x + 0.5) * scale);
  const y = Math.floor((at.y + 0.5) * scale);
  return film.contains(x, y) ? { x, y } : null;
}

/**
 * @param {number} width
 * @param {number} height
 * @param {import("./film-view.js").FilmHandlers} handlers
 * @returns {FilmView | CannotShow}
 */
function filmView(width, height, handlers) {
  try {
    return new FilmView(width, height, handlers);
  } catch (error) {
    if (error instanceof CannotShow) return error;
    throw error;
  }
}

/** @param {CannotShow} refusal */
function filmErrorView({ message }) {
  return h(
    "div",
    { class: "stage" },
    emptyState("image", t("The live picture cannot be shown here"), h("p", null, message)),
  );
}
