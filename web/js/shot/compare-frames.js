/** The frame of a comparison with shots: both sides show the same one, or their nearest. */

import { h, setText } from "../base/dom.js";
import { LiveFilm } from "../film/live-film.js";
import { parseFrames } from "../base/frame-numbers.js";
import { isShot } from "../base/shot-words.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../views/compare.js").Comparison} Comparison */

/** Delay while the slider is dragged, so that frames in between are skipped. */
const REST_MS = 120;

/** @param {Job | null} job null: an uploaded picture @returns {number[]} in order; none where it is no shot */
function numbersOf(job) {
  const numbers = job && isShot(job) ? parseFrames(job.shot?.frames ?? "") : [];
  return typeof numbers === "string" ? [] : numbers.sort((a, b) => a - b);
}

/** @param {number[]} numbers not empty @param {number} wanted */
const nearest = (numbers, wanted) => numbers.reduce((best, n) => (Math.abs(n - wanted) < Math.abs(best - wanted) ? n : best));

/**
 * Returns the frame of a job nearest to the requested one.
 *
 * @param {Job | null} job
 * @param {number | null} wanted
 * @returns {number | undefined} undefined: the only one, or the first
 */
export function frameOf(job, wanted) {
  const numbers = numbersOf(job);
  return wanted === null || !numbers.length ? numbers[0] : nearest(numbers, wanted);
}

/**
 * @param {() => import("../film/picture-side.js").FilmSource[]} films left and right, which may be one
 * @param {() => (Job | null)[]} jobs likewise
 * @param {import("../base/store.js").Store<Comparison>} state
 * @param {import("../base/store.js").Disposer} life
 * @returns {{element: HTMLElement, update: () => void}}
 */
export function compareFrames(films, jobs, state, life) {
  const title = h("h2");
  const slider = h("input", { type: "range", "aria-label": t("Frame"), min: "0", step: "1" });
  const note = h("p", { class: "quiet small number" });
  const element = h("section", { class: "side-section stack tight", "aria-label": t("Frame") }, title, slider, note);
  /** Union of both sides' frames. @type {number[]} */
  let numbers = [];
  let told = "";

  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let resting;
  const turn = () => {
    const now = films();
    for (const live of new Set(now)) {
      const frame = frameOf(jobs()[now.indexOf(live)] ?? null, state.value.frame);
      if (live instanceof LiveFilm && frame !== undefined && frame !== live.frame) live.turnTo(frame, live.film);
    }
  };
  const show = () => {
    const [a, b] = jobs();
    const shots = [a, b].map((job) => frameOf(job ?? null, state.value.frame));
    const shown = state.value.frame ?? numbers[0] ?? 0;
    const at = numbers.length ? numbers.indexOf(nearest(numbers, shown)) : 0;
    slider.valueAsNumber = at;
    const number = numbers[at] ?? 0;
    slider.setAttribute("aria-valuetext", `Frame ${number}`);
    setText(title, t("Frame {number}", { number }));
    const others = ["A", "B"].flatMap((letter, i) => {
      const frame = shots[i];
      if (frame === undefined) return [t("{letter} is a still", { letter })];
      return frame === number ? [] : [t("{letter} shows frame {frame}, the nearest that it has", { letter, frame })];
    });
    setText(note, others.length ? `${others.join("; ")}.` : "");
    note.hidden = others.length === 0;
  };
  slider.addEventListener("input", () => state.update((now) => ({ ...now, frame: numbers[slider.valueAsNumber] ?? null })));
  const update = () => {
    const texts = jobs().map((job) => (job && isShot(job) ? (job.shot?.frames ?? "") : ""));
    if (texts.join() === told && numbers.length) return;
    told = texts.join();
    numbers = [...new Set(jobs().flatMap(numbersOf))].sort((a, b) => a - b);
    element.hidden = numbers.length < 2;
    slider.max = String(Math.max(0, numbers.length - 1));
    show();
  };
  update();
  let frame = state.value.frame;
  life.add(
    state.subscribe((now) => {
      if (now.frame === frame) return;
      frame = now.frame;
      show();
      clearTimeout(resting);
      resting = setTimeout(turn, REST_MS);
    }),
  );
  life.add(() => clearTimeout(resting));
  return { element, update };
}
