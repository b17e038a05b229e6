/** The playback controls of a shot: play, step, scrub, loop, in and out points, and the loaded part. */

import { h, setText } from "../base/dom.js";
import { bytes, count } from "../base/format.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";

/** @typedef {import("./shot-frames.js").ShotFrames} ShotFrames */
/** @typedef {import("./player.js").Player} Player */
/** @typedef {import("./frame-memory.js").FrameMemory} FrameMemory */

/**
 * @param {ShotFrames} frames
 * @param {Player} player
 * @param {FrameMemory} memory
 * @param {import("../base/store.js").Disposer} life
 * @returns {{element: HTMLElement, showLoaded: () => void}}
 */
export function playBar(frames, player, memory, life) {
  /** @param {import("../base/icons.js").IconName} symbol @param {string} label @param {string} title @param {() => void} onclick */
  const button = (symbol, label, title, onclick) =>
    h("button", { class: "icon-button", type: "button", "aria-label": label, title, onclick }, icon(symbol));
  const step = (/** @type {number} */ by) => () => (player.pause(), frames.go(frames.at + by));
  const play = button("play", t("Play"), t("Play (Space)"), () => player.toggle());
  const scrub = h("input", { type: "range", class: "scrub", "aria-label": t("Frame"), min: "0", step: "1" });
  scrub.addEventListener("input", () => {
    player.pause();
    memory.wanted = true;
    frames.go(scrub.valueAsNumber);
    memory.fill();
  });
  const number = h("strong", { class: "frame-number number" });
  const loop = button("refresh", t("Loop"), t("From the end to the beginning"), () => player.loop.update((on) => !on));
  const clear = button("close", t("Play all frames again"), t("All frames again (X)"), () => frames.range.set(null));
  const partText = h("span", { class: "quiet small number" });
  const part = h("span", { class: "row part" }, partText, clear);
  const inMemory = h("span");
  const amount = h("span", { class: "amount" });
  const loaded = h("span", { class: "quiet small number loaded" }, inMemory, amount);
  const marks = h(
    "span",
    { class: "row marks" },
    h("button", { class: "text-button small", type: "button", title: t("Play from this frame (I)"), onclick: () => frames.mark("in") }, t("In")),
    h("button", { class: "text-button small", type: "button", title: t("Play to this frame (O)"), onclick: () => frames.mark("out") }, t("Out")),
  );
  const element = h(
    "div",
    { class: "play-bar", role: "group", "aria-label": t("Play the shot") },
    h("span", { class: "row buttons" }, button("back", t("Previous frame"), t("Previous frame (←)"), step(-1)), play, button("next", t("Next frame"), t("Next frame (→)"), step(1)), loop),
    number,
    scrub,
    marks,
    part,
    loaded,
  );

  const showLoaded = () => {
    const { here, of } = memory.loaded();
    loaded.hidden = !memory.wanted;
    setText(inMemory, t("{here} of {of}", { here: count(here), of: count(of) }));
    setText(amount, t(" in memory, {bytes}", { bytes: bytes(memory.bytes()) }));
    element.style.setProperty("--loaded", String(of ? here / of : 0));
  };
  const showPart = () => {
    const { value } = frames.numbers;
    const [from, to] = frames.part;
    part.hidden = frames.range.value === null;
    setText(partText, `${value[from]}–${value[to]}`);
    const last = Math.max(1, value.length - 1);
    element.style.setProperty("--from", String(from / last));
    element.style.setProperty("--to", String(to / last));
    showLoaded();
  };
  life.add(
    player.playing.subscribe((on) => {
      play.replaceChildren(icon(on ? "pause" : "play"));
      play.setAttribute("aria-label", on ? t("Stop playing") : t("Play"));
    }),
  );
  life.add(player.loop.subscribe((on) => loop.setAttribute("aria-pressed", String(on))));
  life.add(
    frames.numbers.subscribe((all) => {
      scrub.max = String(all.length - 1);
      scrub.valueAsNumber = frames.at;
      showPart();
    }),
  );
  life.add(
    frames.current.subscribe((current) => {
      setText(number, current);
      scrub.valueAsNumber = frames.at;
      scrub.setAttribute("aria-valuetext", t("Frame {number}", { number: current ?? "" }));
    }),
  );
  life.add(frames.range.subscribe(showPart));
  return { element, showLoaded };
}
