/** The keys of a shot. */

import { announce } from "../shell/tray.js";
import { frameSentence } from "./filmstrip.js";
import { t } from "../base/words.js";

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
    announce(t("Plays from frame {from} to {to}", { from: frames.numbers.value[from] ?? "", to: frames.numbers.value[to] ?? "" }));
  };
  return [
    { keys: "Space", does: t("Play or stop the shot"), run: () => player.toggle() },
    ...step("ArrowLeft", "← →", t("Previous or next frame; with Shift, extend the played range"), () => frames.at - 1),
    ...step("ArrowRight", null, "", () => frames.at + 1),
    ...step("Home", "Home, End", t("First or last frame; with Shift, extend the played range to it"), () => 0),
    ...step("End", null, "", () => last()),
    { keys: "I", does: t("Play from this frame"), run: mark("in") },
    { keys: "O", does: t("Play to this frame"), run: mark("out") },
    { keys: "X", does: t("Play all frames again"), run: () => frames.range.set(null) },
    { keys: "Enter", does: t("Render this frame first"), run: renderFirst },
  ];
}
