/** The parts of a job's page for a shot: filmstrip, player, and the frame shown on the stage. */

import { isMixed, plainStrip } from "../film/light-mix.js";
import { scenes } from "../news/farm.js";
import { here, setParams } from "../shell/router.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { filmstrip } from "./filmstrip.js";
import { FrameMemory } from "./frame-memory.js";
import { framePanel } from "./frame-panel.js";
import { playBar } from "./play-bar.js";
import { Player } from "./player.js";
import { shotEdit } from "./shot-edit.js";
import { ShotFrames } from "./shot-frames.js";
import { shotKeys } from "./shot-keys.js";
import { shotSave } from "./shot-save.js";

/** @typedef {import("../base/types.js").Job} Job */

const USUAL_FPS = 24;
/** Delay after stepping before the live frame is loaded; until then the frame from memory is shown. */
const REST_MS = 150;
const URL_MS = 400;
const FILL_MS = 1000;

/**
 * @param {() => Job} job
 * @param {import("../film/live-picture.js").LivePicture} picture
 * @param {import("../base/store.js").Store<import("../job/display-panel.js").Display>} display
 * @param {import("../base/store.js").Disposer} life
 */
export function shotDesk(job, picture, display, life) {
  const { live } = picture;
  const first = job();
  const frames = new ShotFrames(first, live.frame);
  const fps = () => job().shot?.fps ?? scenes.value?.find(({ id }) => id === job().scene)?.fps ?? USUAL_FPS;
  const memory = new FrameMemory(first.id, live.film, frames, () => changed());
  const player = new Player(frames, memory, fps);
  const bar = playBar(frames, player, memory, life);
  const strip = filmstrip(first, frames, life);
  const panel = framePanel(job, frames, life);
  const edit = shotEdit(job, frames, life);
  let changed = () => {
    bar.showLoaded();
    if (player.playing.value) show();
  };

  live.framesChanged = (news) => {
    frames.take(news);
    memory.fill();
  };
  life.every(FILL_MS, () => memory.fill());
  life.add(() => ((changed = () => {}), player.pause(), memory.dispose()));

  /** Shows the current frame from memory. */
  const show = () => {
    const film = memory.film(frames.current.value);
    if (film) picture.side()?.play(film);
  };
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let resting;
  let steppedAt = -Infinity;
  const settle = () => {
    clearTimeout(resting);
    if (live.frame === frames.current.value) picture.side()?.play(null);
    else live.turnTo(frames.current.value, memory.film(frames.current.value));
  };
  life.add(() => clearTimeout(resting));
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let telling;
  life.add(() => clearTimeout(telling));
  const { path } = here();
  const remember = () => {
    clearTimeout(telling);
    telling = setTimeout(() => {
      if (here().path.join() === path.join()) setParams({ frame: String(frames.current.value) });
    }, URL_MS);
  };

  let began = false; // a store calls its listener at once
  life.add(
    frames.current.subscribe(() => {
      if (!began) return;
      show();
      if (player.playing.value) return;
      const now = performance.now();
      const fast = now - steppedAt < REST_MS;
      steppedAt = now;
      remember();
      clearTimeout(resting);
      if (fast) resting = setTimeout(settle, REST_MS);
      else settle();
    }),
  );
  life.add(
    player.playing.subscribe((on) => {
      if (on) {
        // Playback shows the raw light.
        const { channel, denoise, mix } = display.value;
        if (channel || denoise !== "off" || isMixed(mix))
          display.update((look) => ({ ...look, channel: "", denoise: "off", mix: look.mix.map(({ name }) => plainStrip(name)) }));
        show();
      } else if (began) {
        settle();
        remember();
      }
    }),
  );
  began = true;
  life.add(frames.range.subscribe(() => (memory.replan(), memory.fill(), bar.showLoaded())));
  life.add(frames.numbers.subscribe(() => (memory.replan(), memory.fill())));
  life.add(addShortcuts(shotKeys(frames, player, panel.renderFirst), "picture"));
  return {
    bar: bar.element,
    strip,
    panel: panel.element,
    edit: edit.element,
    files: shotSave(first, display, frames, life),
    /** Shows a frame. @param {number} number */
    goTo: (number) => frames.go(frames.numbers.value.indexOf(number)),
    /** @param {Job} next */
    update(next) {
      frames.update(next);
      panel.update();
      edit.update();
    },
  };
}
