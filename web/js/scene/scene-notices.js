/** Notices about a scene: its preparation, errors, warnings, and remedies. */

import { GUESSED, IMAGE_GUESSED, INVISIBLE, MISSING_FILE, PROFILE_IGNORED, SEVERAL_SCENES, STRICT, WAITS_FOR_BLENDER, WITHOUT_AREA, WITHOUT_LIGHT, hasCode, missingFiles } from "../base/codes.js";
import { h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { said, saidApart, saidOf } from "../base/said.js";
import { t, tn } from "../base/words.js";
import { field } from "../forms/fields.js";
import { choose } from "../shell/drops.js";
import { command, emptyState } from "../shell/hints.js";
import { linkTo } from "../shell/router.js";
import { addFiles, showOther } from "../shell/uploads.js";

/** @typedef {import("../base/types.js").Scene} Scene */

/** Codes of warnings that the form shows as a choice, or the view as a sentence. */
const WITHOUT_WARNING = [WITHOUT_LIGHT, SEVERAL_SCENES, ...INVISIBLE];

/** @param {Scene} scene @param {string} sentence one of its warnings */
const codedOf = (scene, sentence) => scene.codes?.["warnings"]?.[scene.warnings.indexOf(sentence)];

/**
 * Says why nothing of a scene can be seen from any side, and what to do; empty where something may be.
 *
 * @param {Pick<Scene, "warnings" | "codes">} scene
 * @param {boolean} [isAsUploaded] whether it is shown as uploaded: in its first frame, and in its usual variant
 */
export function invisibleWords(scene, isAsUploaded = true) {
  const codes = isAsUploaded ? INVISIBLE : WITHOUT_AREA;
  const number = scene.codes?.["warnings"]?.findIndex((/** @type {import("../base/said.js").Coded | null} */ coded) => hasCode(coded, codes)) ?? -1;
  return number < 0 ? "" : said(scene.warnings[number], scene.codes?.["warnings"]?.[number]);
}

/** @param {Pick<Scene, "step" | "codes">} scene @returns {string} */
export function stepWords(scene) {
  if (waitsForBlender(scene)) return t("Waiting for a worker with Blender …"); // the view explains it
  const words = saidOf(scene, "step");
  return words && `${words[0]?.toUpperCase()}${words.slice(1).replace(/[.。]$/, "")} …`;
}

/** Whether no connected worker can open a scene's file, since none has Blender. @param {Pick<Scene, "codes">} scene */
export const waitsForBlender = ({ codes }) => hasCode(codes?.["step"], WAITS_FOR_BLENDER);

/** Explains how a scene's file that needs Blender is opened. */
export function blenderNotice() {
  return emptyState(
    "cube",
    t("This file needs Blender"),
    h("p", null, t("No connected worker has it. Restart the farm with it, or add a machine that has it:")),
    command("python3 farm.py up --blender"),
    h("p", null, h("a", { href: linkTo("workers") }, t("Add a machine")), " ", h("code", null, "--blender")),
    h("p", null, t("Or export glTF in Blender, with “Punctual Lights” and “Cameras” ticked, and drop that here.")),
  );
}

/** The reason why a scene cannot be rendered, and the remedies. @param {Scene} scene @param {string | null} place where in its files @param {() => void} remove deletes it */
export function failure(scene, place, remove) {
  const add = addButton(scene, [scene.codes?.["error"]]);
  add?.classList.add("primary");
  const [error, cause] = saidApart(scene, "error");
  // The error of a strict scene is a list of its warnings.
  const why = isRefused(scene)
    ? [t("It was uploaded as strict, so its warnings are errors. Upload it here to accept them."), warningList(scene, scene.warnings)]
    : [error];
  return [
    h(
      "div",
      { class: "failure", role: "alert" },
      h("h2", null, icon("warning"), t("This cannot be rendered")),
      h("p", null, ...why),
      cause && !isRefused(scene) && h("details", { class: "failure-cause small" }, h("summary", null, t("Details")), h("p", null, cause)),
      place && h("p", { class: "failure-place" }, h("span", { class: "quiet" }, t("Location")), h("code", null, place)),
    ),
    h(
      "div",
      { class: "row wraps for-submit" },
      add,
      h("button", { class: `button ${add ? "" : "primary"}`, type: "button", onclick: () => choose({ folder: false }) }, icon("upload"), t("Upload it again")),
      add && h("button", { class: "button", type: "button", onclick: () => choose({ folder: true }) }, icon("folder"), t("Upload a folder")),
      h("button", { class: "button danger", type: "button", onclick: remove }, icon("trash"), t("Delete")),
    ),
    h("p", { class: "quiet small for-submit" }, t("or drop it anywhere on this page")),
  ];
}

/** Returns true if a strict scene failed because of its warnings. @param {Scene} scene */
function isRefused(scene) {
  return scene.strict && scene.warnings.length > 0 && hasCode(scene.codes?.["error"], STRICT);
}

/** @param {Scene} scene @param {string[]} some of its warnings */
function warningList(scene, some) {
  return h("ul", { "aria-label": t("Warnings") }, some.map((sentence) => h("li", null, warning(scene, sentence))));
}

/** Returns the beginning of a folded warning: of frequent notes a few words without places in the file. @param {string} sentence @param {import("../base/said.js").Coded | null | undefined} coded */
function beginningOf(sentence, coded) {
  if (hasCode(coded, PROFILE_IGNORED)) return t("A texture's colour profile is ignored");
  if (hasCode(coded, IMAGE_GUESSED)) return t("The only image beside the file is its texture");
  return said(sentence, coded);
}

/** The warnings about a scene, ignored or approximated parts, as a line that opens. @param {Scene} scene */
export function warnings(scene) {
  const rank = (/** @type {string} */ sentence) => {
    const coded = codedOf(scene, sentence);
    return hasCode(coded, MISSING_FILE) ? 0 : hasCode(coded, GUESSED) ? 2 : 1;
  };
  const sentences = scene.warnings.filter((sentence) => !WITHOUT_WARNING.some((code) => hasCode(codedOf(scene, sentence), code))).toSorted((a, b) => rank(a) - rank(b));
  const [first] = sentences;
  if (first === undefined) return null;
  const serious = sentences.filter((sentence) => rank(sentence) < 2).length;
  const missing = sentences.flatMap((sentence) => missingFiles(codedOf(scene, sentence)));
  const beginning = missing.length ? t("Missing: {names}", { names: [...new Set(missing)].join(", ") }) : beginningOf(first, codedOf(scene, first));
  const isInvisible = invisibleWords(scene) !== ""; // the view says so, and nothing else matters as much
  const count = serious ? tn(serious, "{n} warning", "{n} warnings") : tn(sentences.length, "{n} note", "{n} notes");
  return h(
    "div",
    { class: serious ? "notice warning folded" : "notice note folded" },
    icon(serious ? "warning" : "info"),
    h("details", { class: "grow" }, h("summary", null, h("span", { class: "first-warning" }, h("strong", null, count), " ", !isInvisible && h("span", { class: "quiet" }, beginning))), warningList(scene, sentences)),
    addButton(scene, sentences.map((sentence) => codedOf(scene, sentence))),
  );
}

/** A choice among the scenes of one upload; another one opens as a scene of its own. @param {Scene} scene @returns {HTMLElement | null} null if there is only one */
export function fileField(scene) {
  const coded = scene.codes?.["warnings"]?.find((/** @type {import("../base/said.js").Coded | null} */ each) => hasCode(each, SEVERAL_SCENES));
  if (!coded) return null;
  const { file, others } = coded.params;
  const select = h("select", null, [file, ...others].map((/** @type {string} */ name) => h("option", { value: name }, name)));
  select.addEventListener("change", (event) => {
    event.stopPropagation(); // it is no setting of this scene's pictures
    void showOther(scene, select.value);
    select.value = file;
  });
  select.addEventListener("input", (event) => event.stopPropagation());
  const element = field(t("File"), select);
  element.classList.add("for-submit");
  return element;
}

/** @param {Scene} scene @param {string} sentence @returns {import("../base/dom.js").Child[]} */
function warning(scene, sentence) {
  const coded = codedOf(scene, sentence);
  if (!hasCode(coded, SEVERAL_SCENES)) return [said(sentence, coded)];
  const { file, others } = coded.params;
  const show = (/** @type {string} */ name) =>
    h("button", { class: "button small for-submit", type: "button", onclick: () => void showOther(scene, name) }, t("Show {name}", { name }));
  return [t("There are several scenes in this upload; {name} is shown.", { name: file }), h("div", { class: "row wraps other-scenes" }, others.map(show))];
}

/**
 * A button that adds the missing files, where a message is about one.
 *
 * @param {Scene} scene
 * @param {(import("../base/said.js").Coded | null | undefined)[]} messages
 */
function addButton(scene, messages) {
  if (!messages.some((coded) => hasCode(coded, MISSING_FILE))) return null;
  return h("button", { class: "button small for-submit", type: "button", onclick: () => addFiles(scene) }, icon("plus"), t("Add files"));
}
