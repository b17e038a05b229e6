/** The filmstrip: thumbnails of all frames with number, state and noise. Only visible ones exist in the DOM. */

import { lookOfJob } from "../film/job-look.js";
import { imageUrl, thumbnailFormat } from "../news/api.js";
import { h, setText } from "../base/dom.js";
import { freshId } from "../forms/fields.js";
import { percent } from "../base/format.js";
import { icon } from "../base/icons.js";
import { Thumbnails } from "./thumbnails.js";
import { saidOf } from "../base/said.js";
import { t } from "../base/words.js";

/** @typedef {import("./shot-frames.js").ShotFrames} ShotFrames */
/** @typedef {import("./shot-frames.js").ShownFrame} ShownFrame */

/** Distance between frames in pixels, as in css/shot.css. */
const PITCH = 116;
const AROUND = 3;
const THUMB_WIDTH = 160;
/** Factor of samples after which a frame's thumbnail is refreshed. */
const WORTH = 2;

/** @type {Record<ShownFrame["state"], string>} */
const WORDS = { paused: t("paused"), queued: t("waits"), preparing: t("is prepared"), running: t("is rendered"), finished: t("finished"), failed: t("failed") };

/**
 * Description of a frame for screen readers.
 *
 * @param {number} number
 * @param {ShownFrame | undefined} frame
 */
export function frameSentence(number, frame) {
  if (!frame) return t("Frame {number}", { number });
  const { state, progress, noise, error } = frame;
  const far = state === "running" || (state === "queued" && progress > 0) ? `, ${Math.floor(progress * 100)} %` : "";
  return t("Frame {number} {state}", { number, state: WORDS[state] }) + far + (noise == null ? "" : t(", noise {noise}", { noise: percent(noise) })) + (error ? `: ${error}` : "");
}

/**
 * @param {import("../base/types.js").Job} job
 * @param {ShotFrames} frames
 * @param {import("../base/store.js").Disposer} life
 * @returns {HTMLElement}
 */
export function filmstrip(job, frames, life) {
  const queue = new Thumbnails();
  const stem = freshId("frame");
  const track = h("div", { class: "strip-track", role: "presentation" });
  const strip = h("div", { class: "filmstrip", role: "listbox", tabindex: "0", "aria-label": t("Frames"), "aria-orientation": "horizontal" }, track);
  /** Cells of the strip, by the index of the frame. @type {Map<number, Cell>} */
  const cells = new Map();

  const show = () => {
    const { value } = frames.numbers;
    track.style.width = `${value.length * PITCH}px`;
    const from = Math.max(0, Math.floor(strip.scrollLeft / PITCH) - AROUND);
    const to = Math.min(value.length - 1, Math.ceil((strip.scrollLeft + strip.clientWidth) / PITCH) + AROUND);
    for (const [place, cell] of cells) {
      if (place >= from && place <= to && cell.number === value[place]) continue;
      queue.forget(cell.image);
      cell.element.remove();
      cells.delete(place);
    }
    for (let place = from; place <= to; place++) {
      const number = value[place] ?? 0;
      let cell = cells.get(place);
      if (!cell) {
        cell = makeCell(number, place, value.length);
        cell.element.id = `${stem}-${place}`;
        cells.set(place, cell);
        track.append(cell.element);
      }
      update(cell, place);
    }
  };

  /** @param {Cell} cell @param {number} place */
  const update = (cell, place) => {
    const frame = frames.shown(cell.number);
    cell.update(frame);
    const [first, last] = frames.part;
    cell.element.setAttribute("aria-selected", String(cell.number === frames.current.value));
    cell.element.classList.toggle("outside", frames.range.value !== null && (place < first || place > last));
    const samples = frame?.samples ?? 0;
    const finished = frame?.state === "finished";
    if (samples && (samples >= cell.pictured * WORTH || (finished && samples !== cell.pictured) || samples < cell.pictured)) {
      cell.pictured = samples;
      queue.ask(cell.image, imageUrl({ job: job.id, frame: cell.number }, thumbnailFormat(job), { width: THUMB_WIDTH, ...lookOfJob(job), v: samples }));
    }
  };

  /** Scrolls the current frame into view. */
  const follow = () => {
    const left = frames.at * PITCH;
    const margin = Math.min(PITCH, strip.clientWidth / 4);
    if (left - margin < strip.scrollLeft || left + PITCH + margin > strip.scrollLeft + strip.clientWidth) {
      const ahead = left + PITCH > strip.scrollLeft + strip.clientWidth ? margin : strip.clientWidth - PITCH - margin;
      strip.scrollLeft = Math.max(0, left - (left < strip.scrollLeft + margin ? ahead : margin));
    }
    show();
    strip.setAttribute("aria-activedescendant", `${stem}-${frames.at}`);
  };

  let drawn = 0;
  const soon = () => (drawn ||= requestAnimationFrame(() => ((drawn = 0), show())));
  strip.addEventListener("scroll", soon, { passive: true });
  strip.addEventListener("click", (event) => {
    const cell = event.target instanceof Element ? event.target.closest(".frame-cell") : null;
    if (cell instanceof HTMLElement) frames.go(Number(cell.dataset.place));
  });
  const resizing = new ResizeObserver(soon);
  resizing.observe(strip);
  life.add(() => {
    resizing.disconnect();
    cancelAnimationFrame(drawn);
    for (const { image } of cells.values()) queue.forget(image);
  });
  life.add(frames.numbers.subscribe(soon));
  life.add(frames.news.subscribe(soon));
  life.add(frames.range.subscribe(soon));
  life.add(frames.current.subscribe(() => strip.isConnected && follow()));
  requestAnimationFrame(follow); // once it has its size
  return strip;
}

/** @typedef {ReturnType<typeof makeCell>} Cell */

/** @param {number} number @param {number} place @param {number} count */
function makeCell(number, place, count) {
  const image = h("img", { alt: "", hidden: true, draggable: false });
  const state = h("span", { class: "frame-state" });
  const noise = h("span", { class: "frame-noise" });
  const bar = h("div", { class: "frame-bar" }, h("div"));
  const name = h("span", { class: "visually-hidden" });
  const element = h(
    "div",
    { class: "frame-cell", role: "option", "aria-setsize": String(count), "aria-posinset": String(place + 1) },
    name,
    h("div", { class: "frame-picture", "aria-hidden": "true" }, image, state),
    bar,
    h("div", { class: "frame-words number", "aria-hidden": "true" }, h("span", null, number), noise),
  );
  element.dataset.place = String(place);
  element.style.transform = `translateX(${place * PITCH}px)`;
  let shown = "";
  return {
    number,
    element,
    image,
    /** Samples of the shown thumbnail. */
    pictured: 0,
    /** @param {ShownFrame | undefined} frame */
    update(frame) {
      const sentence = frameSentence(number, frame);
      if (sentence === shown) return;
      shown = sentence;
      setText(name, sentence);
      element.title = saidOf(frame, "error");
      element.classList.toggle("failed", frame?.state === "failed");
      element.classList.toggle("running", frame?.state === "running");
      state.replaceChildren(...(frame?.state === "failed" ? [icon("warning")] : []));
      setText(noise, frame?.state === "failed" ? t("failed") : frame?.noise == null ? "" : percent(frame.noise));
      bar.className = `frame-bar ${frame?.state ?? ""}`;
      /** @type {HTMLElement} */ (bar.firstElementChild).style.transform = `scaleX(${frame?.progress ?? 0})`;
    },
  };
}
