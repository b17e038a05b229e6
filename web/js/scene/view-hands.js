/** What the user's hands do in a live view: navigation, tools, keys, points to pick, and the hint about all these. */

import { h, setText } from "../base/dom.js";
import { t } from "../base/words.js";
import { PLACE_SUN } from "../forms/environment-fields.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { heldKey, lightHand } from "./light-hand.js";
import { alongSight, floorBelow, lookAt } from "./orbit.js";
import { sunHand } from "./sun-hand.js";
import { viewHand } from "./view-hand.js";
import { viewTools } from "./view-tools.js";

/** @typedef {import("../base/types.js").View} View */
/** @typedef {import("./view-link.js").Picked} Picked */

/** Listed in the help; the view handles them while it has focus. */
const HAND_KEYS = [
  { keys: "W A S D Q E", does: t("In the view: fly; with Shift faster") },
  { keys: t("Arrows"), does: t("In the view: turn it; with Shift move it") },
  { keys: "− +", does: t("In the view: nearer and farther") },
];

/**
 * @param {object} view
 * @param {import("../base/types.js").Scene} view.scene
 * @param {import("./settings-form.js").SettingsForm} view.form
 * @param {HTMLElement} view.frame around the surface and the stage
 * @param {HTMLElement} view.surface
 * @param {() => {isOpen: boolean, hasLive: boolean}} view.instead state of the stage that replaces the view
 * @param {() => HTMLElement} view.seen where the picture is
 * @param {() => {width: number, height: number}} view.size of the latest request, in pixels
 * @param {(at: [number, number]) => void} view.pick requests the surface at a pixel
 * @param {(view: View) => void} view.turn
 * @param {() => void} view.refresh requests the view again
 * @param {() => void} view.exposeAuto
 * @param {() => void} view.leaveStage shows the live view alone
 */
export function viewHands({ scene, form, frame, surface, instead, seen, size, pick: send, turn, refresh, exposeAuto, leaveStage }) {
  const hint = h("p", { class: "small quiet view-hint" });
  /** Handler of the next picked point. @type {((picked: Picked) => void) | null} */
  let onPicked = null;
  /** Whether the lens is focused but has no aperture yet, so that the focus is not visible. */
  let isFocused = false;
  /** @param {string} [sentence] the usual hint without one */
  const tell = (sentence = "") => {
    isFocused = false;
    const touch = matchMedia("(pointer: coarse)").matches;
    const usual = touch
      ? t("Drag with two fingers to move the view; tap it first to turn it with one.")
      : t("Drag to turn, Shift-drag to move, scroll to zoom; W A S D Q E to fly.");
    const ofStage = touch
      ? t("Drag with one finger to pan, pinch to zoom.")
      : t("Drag moves the picture, the wheel zooms; Escape goes back to the live view.");
    setText(hint, sentence || (instead().isOpen ? ofStage : usual));
    hint.classList.toggle("usual", !sentence);
  };
  /** @param {MouseEvent} event @param {(picked: Picked, at: {x: number, y: number}) => void} then */
  const pick = (event, then) => {
    const { width, height } = size();
    const box = surface.getBoundingClientRect();
    const within = (/** @type {number} */ share, /** @type {number} */ most) => Math.min(Math.max(Math.floor(share * most), 0), most - 1);
    const at = { x: within((event.clientX - box.left) / box.width, width), y: within((event.clientY - box.top) / box.height, height) };
    onPicked = (found) => {
      if (found.x !== at.x || found.y !== at.y) return; // of an earlier click
      onPicked = null;
      then(found, at);
    };
    send([at.x, at.y]);
  };
  /** @param {PointerEvent} event */
  const focusAt = (event) =>
    pick(event, ({ depth }, at) => {
      if (!depth) {
        tell(t("There is nothing to focus on here. Click an object."));
        return;
      }
      const distance = alongSight(form.view(), size(), at, depth);
      form.focus(distance);
      tools.choose("");
      const told = t("Sharp at a distance of {distance}.", { distance: distance.toPrecision(4) });
      tell(form.view().aperture ? told : t("{told} Set an aperture to see it.", { told }));
      isFocused = !form.view().aperture;
      refresh();
    });

  const light = lightHand(frame, seen, form.light);
  const tools = viewTools(
    surface,
    [
      light.tool,
      sunHand(surface, form.light, pick, tell),
      {
        ...{ name: "focus", icon: /** @type {const} */ ("target"), label: t("Pick the focus"), short: t("Focus"), title: t("Pick the focus") },
        ...{ hint: t("Click what is to be sharp."), press: focusAt },
      },
    ],
    tell,
  );
  const lightButton = tools.buttons.get("light");
  const letGo = viewHand(surface, {
    view: form.view,
    turn(next) {
      if (hint.classList.contains("usual")) setText(hint, ""); // known by now
      turn(next);
    },
    size: diagonal(scene.bounds),
    floor: () => floorBelow(Boolean(scene.has_floor), scene.cameras.at(-1)?.view.up ?? [0, 1, 0], scene.bounds?.[0] ?? [], diagonal(scene.bounds)),
    pressed: tools.press,
    keyed: tools.key,
    centre: (event) => tools.chosen() || pick(event, ({ position }) => position && turn(lookAt(form.view(), position))),
  });
  const lightKey = heldKey("l", () => tools.chosen() === "light", (on) => {
    const { isOpen, hasLive } = instead();
    if (isOpen && !hasLive) return;
    tools.choose(on ? "light" : "");
    if (on) (isOpen ? lightButton : surface)?.focus({ preventScroll: true });
  });
  lightButton?.addEventListener("keydown", (event) => tools.key(event) && event.preventDefault());
  const endKeys = addShortcuts([
    { keys: "N", does: t("Auto exposure"), run: exposeAuto },
    { keys: "L", shown: t("L, arrows"), does: t("Turn the light: hold and drag, or press and use the arrows"), run: lightKey.down },
    { keys: "Escape", does: t("Undo the drag; leave the tool; return to the live view"), run: () => void (tools.escape() || leaveStage()) },
    ...HAND_KEYS.map(({ keys, does }) => ({
      ...{ keys: `View: ${keys}`, does, run: () => {} },
      get shown() {
        return instead().isOpen ? null : keys;
      },
    })),
  ], "view");
  const placeSun = () => (tools.choose("sun"), surface.scrollIntoView({ block: "nearest" }), surface.focus({ preventScroll: true }));
  form.element.addEventListener(PLACE_SUN, placeSun);
  // The light tool also works over the stage, which otherwise pans its picture.
  frame.addEventListener(
    "pointerdown",
    (event) => {
      const { isOpen, hasLive } = instead();
      const isOnPicture = isOpen && hasLive && !(/** @type {Element} */ (event.target).closest(".wipe, .view-floating"));
      if (isOnPicture && tools.press(event)) event.stopPropagation();
    },
    true,
  );
  frame.addEventListener("contextmenu", (event) => event.shiftKey && event.preventDefault());
  return {
    hint,
    buttons: [...tools.buttons.values()],
    readout: light.readout,
    tell,
    isPicking: () => onPicked !== null,
    /** @param {Picked} found */
    take: (found) => onPicked?.(found),

    /** Shows the tools that are applicable, and ends a hint that no longer is. */
    update() {
      const { isOpen, hasLive } = instead();
      const canFocus = (form.view().projection ?? "perspective") === "perspective";
      for (const [name, button] of tools.buttons) {
        button.hidden = isOpen ? !(hasLive && name === "light") : name === "focus" && !canFocus;
        if (button.hidden && tools.chosen() === name) tools.choose("");
      }
      if (isFocused && form.view().aperture) tell();
    },

    dispose() {
      letGo();
      light.dispose();
      lightKey.dispose();
      endKeys();
      form.element.removeEventListener(PLACE_SUN, placeSun);
    },
  };
}

/** @param {number[][] | null} bounds */
function diagonal(bounds) {
  const [lower, upper] = bounds ?? [];
  return lower && upper ? Math.hypot(...upper.map((value, i) => value - (lower[i] ?? 0))) || 1 : 1;
}
