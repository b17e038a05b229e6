/** Still or shot: a time, or several frames of an animated scene or a turntable. */

import { choiceField, explain, field, freshId, numberOf, segments, setShown } from "../forms/fields.js";
import { h, setText } from "../base/dom.js";
import { numberFor } from "../forms/setting-field.js";
import { settingOf } from "../news/settings-table.js";
import { parseFrames } from "../base/frame-numbers.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../scene/form-start.js").ShotStart} ShotStart */

const USUAL_FPS = 24;
const TURN_S = 4;
/** Tolerance in frames for key times that are rounded in the file. */
const ROUNDED = 1e-3;

/**
 * @param {Scene} scene
 * @param {ShotStart | null} like whose settings are the initial values
 * @param {() => void} changed
 * @param {boolean} [asShot] whether an animated scene is rendered as a shot by default
 * @returns {{elements: HTMLElement[], get: () => Record<string, any>, count: () => number}} count: of frames
 */
export function shotFields(scene, like, changed, asShot = false) {
  const setting = (/** @type {string} */ name) => settingOf("shot", name);
  const { clips = [], fps: own = null } = scene;
  const moves = clips.some(({ start, end }) => end > start);

  const fps = numberFor(setting("fps"), like?.fps ?? own ?? USUAL_FPS);
  const turn = numberFor(setting("turntable"), moves ? null : (like?.turntable ?? TURN_S));
  const frames = h("input", { type: "text", inputmode: "text", autocomplete: "off", spellcheck: "false" });
  const moment = h("input", { type: "number", min: 0, step: 0.5, value: "0", inputmode: "decimal", autocomplete: "off" });
  const choices = clipChoices(clips);
  const clip = choiceField(t("Clip"), choices, like?.clip ?? clips[0]?.name ?? "", () => refill());
  const order = choiceField(t("Order"), setting("order").choices ?? [], like?.order ?? "in-turn", () => show());
  const every = numberFor(setting("every"), like?.every ?? setting("every").default);
  let typed = like !== null && like.count > 1;

  const framesField = field(t("Frames"), frames, t("Numbers and ranges: 0-99, or 1-250x5 for every fifth."));
  explain(framesField, t("Frames"), [frames]);
  const everyField = field(t("Every"), every);
  const turnField = field(t("Turn duration, s"), turn, setting("turntable").help);
  const stillField = field(t("Frame"), moment);
  moment.title = t("The moment that is shown; halves are frames too. The view follows.");
  const scrub = h("input", { type: "range", min: 0, max: 1, value: "0", "aria-label": t("Moment") });
  const row = h("div", { class: "slider-row" });
  moment.replaceWith(row);
  row.append(scrub, moment);
  moment.addEventListener("input", () => (scrub.value = moment.value));
  scrub.addEventListener("input", () => {
    moment.value = scrub.value;
    moment.dispatchEvent(new Event("change", { bubbles: true })); // updates the live view at once
  });
  const shotPart = h(
    "div",
    { class: "stack" },
    framesField, field(t("Frames a second"), fps), !moves && turnField, order.element, everyField);

  /** The frames of the clip's animation, or of one turn of the camera. */
  const whole = () => {
    const rate = numberOf(fps, USUAL_FPS);
    const seconds = numberOf(turn, 0);
    if (seconds) return `0-${Math.max(1, Math.round(seconds * rate) - 1)}`;
    const chosen = clips.filter((_, i) => clip.get() === "all" || clip.get() === choices[i]?.name);
    const start = Math.min(...chosen.map((each) => each.start));
    const end = Math.max(...chosen.map((each) => each.end));
    return chosen.length ? `${Math.ceil(start * rate - ROUNDED)}-${Math.floor(end * rate + ROUNDED)}` : "0-95";
  };
  const numbers = () => {
    const found = parseFrames(frames.value);
    return typeof found === "string" ? [] : found;
  };
  const refill = () => {
    const found = parseFrames(whole());
    if (typeof found !== "string") scrub.max = String(found.at(-1) ?? 1);
    scrub.value = moment.value;
    if (!typed) frames.value = whole();
    check();
  };
  const check = () => {
    const found = isShot() ? parseFrames(frames.value) : [];
    frames.setCustomValidity(typeof found === "string" ? found : "");
    const count = numbers().length;
    const length = count / numberOf(fps, USUAL_FPS);
    setText(kind.aside, isShot() && count ? `${tn(count, "{n} frame", "{n} frames")}, ${Number(length.toFixed(2))} s` : "");
    changed();
  };
  frames.addEventListener("input", () => ((typed = frames.value !== ""), check()));
  for (const input of [fps, turn]) input.addEventListener("input", refill);

  let chosen = (like && like.count > 1) || (asShot && moves) ? "shot" : "still";
  const isShot = () => chosen === "shot";
  const show = () => {
    setShown(shotPart, isShot());
    setShown(stillField, !isShot() && moves);
    setShown(everyField, isShot() && order.get() === "every-nth");
    clip.element.hidden = clips.length < 2;
    check();
  };
  const options = [
    { value: "still", label: t("Still") },
    { value: "shot", label: t("Shot") },
  ];
  const kind = segments(t("Picture"), options, (value) => ((chosen = value), refill(), show()));
  kind.select(chosen);
  frames.id ||= freshId("frames");
  if (like) {
    if (like.count > 1) frames.value = like.frames;
    else moment.value = like.frames;
  }
  refill();
  show();

  const ofClip = () => (clips.length > 1 && clip.get() !== (clips[0]?.name ?? "") ? { clip: clip.get() } : {});
  const get = () => {
    if (!isShot()) {
      const frame = moves ? numberOf(moment, 0) : 0;
      return { ...(frame ? { frame } : {}), ...ofClip() };
    }
    const rate = numberOf(fps, USUAL_FPS);
    const seconds = numberOf(turn, 0);
    return {
      frames: frames.value.trim(),
      ...(rate === own ? {} : { fps: rate }),
      ...(seconds ? { turntable: seconds } : {}),
      ...ofClip(),
      order: order.get(),
      ...(order.get() === "every-nth" ? { every: numberOf(every, 8) } : {}),
    };
  };
  return { elements: [kind.element, clip.element, stillField, shotPart], get, count: () => (isShot() ? numbers().length : 1) };
}

/** @param {import("../base/types.js").Clip[]} clips */
function clipChoices(clips) {
  const seconds = (/** @type {import("../base/types.js").Clip} */ { start, end }) =>
    t("Animated from {start} to {end} s.", { start: Number(start.toFixed(2)), end: Number(end.toFixed(2)) });
  const together = { name: "all", label: t("All at once"), help: t("For files with one clip per object.") };
  const known = new Set();
  const each = clips.map((clip, i) => {
    // By number if it has no name, or an ambiguous one.
    const plain = clip.name && !known.has(clip.name);
    known.add(clip.name);
    if (clip.name === "all") return { ...together, help: seconds(clip) };
    return { name: plain ? clip.name : String(i), label: plain ? clip.name : `${clip.name || t("Clip")} (${i})`, help: seconds(clip) };
  });
  return clips.some((clip) => clip.name === "all") ? each : [...each, together];
}
