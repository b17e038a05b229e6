/** The keys of a shot. */

import { announce } from "../shell/tray.js";
import { frameSentence } from "./filmstrip.js";

/** @typedef {import("../shell/shortcuts.js").Shortcut} Shortcut */

/**
 * @param {import("./shot-frames.js").ShotFrames} frames
 * @param {import("./player.js").Player} player
 * @param {() => void} renderFirst
 * @returns {Shortcut[]}
 */
export function shotKeys(frames, player, renderFirst) {
  const last = () => frames.numbers.value.length - 1;
  const told = () => announce(frameSentence(frames.current.value, frames.frame ?? undefined));
  /** @param {string} keys @param {string | null} shown @param {string} does @param {() => number} place */
  const step = (keys, shown, does, place) => [
    { keys, shown, does, run: () => (player.pause(), frames.go(place()), told()) },
    { keys: `Shift+${keys}`, shown: null, does, run: () => (player.pause(), frames.stretch(place()), told()) },
  ];
  const mark = (/** @type {"in" | "out"} */ end) => () => {
    frames.mark(end);
    const [from, to] = frames.part;
    announce(`Plays from frame ${frames.numbers.value[from]} to ${frames.numbers.value[to]}`);
  };
  return [
    { keys: "Space", does: "Play or stop the shot", run: () => player.toggle() },
    ...step("ArrowLeft", "← →", "The frame before, the next; with Shift the part that is played grows", () => frames.at - 1),
    ...step("ArrowRight", null, "", () => frames.at + 1),
    ...step("Home", "Home, End", "The first frame, the last; with Shift all up to it is played", () => 0),
    ...step("End", null, "", () => last()),
    { keys: "I", does: "Play from this frame", run: mark("in") },
    { keys: "O", does: "Play to this frame", run: mark("out") },
    { keys: "X", does: "Play all frames again", run: () => frames.range.set(null) },
    { keys: "Enter", does: "Render this frame first", run: renderFirst },
  ];
}
