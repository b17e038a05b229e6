/** The current frame: its state, and actions to render it first, again, or with more samples. */

import { h, setText } from "../base/dom.js";
import { compact, percent } from "../base/format.js";
import { icon } from "../base/icons.js";
import { change } from "../job/job-panel.js";
import { stateChip } from "../shell/state-chip.js";
import { announce } from "../shell/tray.js";
import { saidOf } from "../base/said.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/**
 * @param {() => Job} job
 * @param {import("./shot-frames.js").ShotFrames} frames
 * @param {import("../base/store.js").Disposer} life
 * @returns {{element: HTMLElement, renderFirst: () => void, update: () => void}}
 */
export function framePanel(job, frames, life) {
  const title = h("h2");
  const chip = stateChip("queued");
  const facts = h("p", { class: "quiet small number" });
  const error = h("p", { class: "problem frame-error", role: "status", hidden: true });
  const renderFirst = () => {
    const number = frames.current.value;
    const state = frames.frame?.state;
    if (state === "finished") return announce(t("Frame {number} is finished", { number }));
    const again = state === "failed" ? { again: String(number), state: /** @type {const} */ ("running") } : {};
    announce(t("Frame {number} is rendered first", { number }));
    void change(job(), { first: number, ...again }, t("The frame could not be moved to the front"));
  };
  const first = h("button", { class: "button wide for-submit", type: "button", title: "Enter", onclick: renderFirst }, icon("play"), h("span"));
  const update = () => {
    const { frame } = frames;
    setText(title, t("Frame {number}", { number: frames.current.value ?? "" }));
    chip.update(frame?.state ?? "queued");
    const noise = frame?.noise == null ? "" : t(", noise {noise}", { noise: percent(frame.noise) });
    setText(facts, frame ? tn(frame.spp, "{n} sample per pixel", "{n} samples per pixel", { n: compact(frame.spp) }) + noise : " ");
    error.hidden = !frame?.error;
    setText(error, saidOf(frame, "error"));
    const isFirst = job().shot?.first === frames.current.value;
    first.hidden = !frame || frame.state === "finished" || job().state === "cancelled";
    first.disabled = isFirst && frame?.state !== "failed";
    const words = frame?.state === "failed" ? t("Try this frame again") : isFirst ? t("Rendered first") : t("Render this frame first");
    setText(/** @type {Element} */ (first.lastElementChild), words);
  };
  life.add(frames.current.subscribe(update));
  life.add(frames.news.subscribe(update));
  const element = h(
    "section",
    { class: "side-section stack tight", "aria-label": t("Frame") },
    h("div", { class: "row spread" }, title, chip.element),
    facts,
    error,
    first,
  );
  return { element, renderFirst, update };
}
