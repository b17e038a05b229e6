/** A scene that cannot be rendered, in the layout of one that can: why and where in place of the view, and beside it what was uploaded. */

import { h } from "../base/dom.js";
import { bytes } from "../base/format.js";
import { icon } from "../base/icons.js";
import { t, tn } from "../base/words.js";
import { failure } from "./scene-notices.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {{file: string, line: number, column: number | null}} Place */

/** Maximum number of files listed. */
const FILES_SHOWN = 12;

/** @param {Scene} scene @param {() => void} remove deletes it @returns {HTMLElement} */
export function failedScene(scene, remove) {
  const place = placeOf(scene);
  const isMain = (/** @type {{path: string}} */ { path }) => path === scene.main;
  const files = (scene.files ?? []).toSorted((a, b) => Number(isMain(b)) - Number(isMain(a)) || a.path.localeCompare(b.path));
  const rest = files.slice(FILES_SHOWN);
  return h(
    "div",
    { class: "workspace-columns" },
    h("div", { class: "workspace-view" }, h("div", { class: "workspace-top failed-scene" }, h("div", { class: "panel" }, ...failure(scene, place && placeWords(place), remove)))),
    h(
      "div",
      { class: "workspace-side" },
      h(
        "section",
        { class: "panel stack", "aria-label": t("Uploaded") },
        h("h2", null, t("Uploaded")),
        h("ul", { class: "uploaded-files" }, files.slice(0, FILES_SHOWN).map((file) => fileRow(file, isMain(file)))),
        rest.length > 0 && h("p", { class: "quiet small number" }, tn(rest.length, "{n} more file, {bytes}", "{n} more files, {bytes}", { bytes: bytes(rest.reduce((sum, { size }) => sum + size, 0)) })),
        h("h2", null, t("Help")),
        h("a", { href: "docs/guides/formats" }, t("Supported features of each format")),
        h("a", { href: "docs/guides/scene-format" }, t("Scene files as text")),
      ),
    ),
  );
}

/** @param {{path: string, size: number}} file @param {boolean} isMain */
function fileRow({ path, size }, isMain) {
  return h("li", { class: isMain ? "main" : "" }, icon(isMain ? "cube" : "image"), h("span", { class: "name", title: path }, path), h("span", { class: "quiet number" }, bytes(size)));
}

/** @param {Place} place */
function placeWords({ file, line, column }) {
  return column === null ? t("{file}, line {line}", { file, line }) : t("{file}, line {line}, column {column}", { file, line, column });
}

/**
 * Returns where a scene's error is, from its code's parameters or, of a library's message, from its text; null if it is not known, or
 * if the error says it in words.
 *
 * @param {Pick<Scene, "error" | "codes" | "main">} scene
 * @returns {Place | null}
 */
export function placeOf({ error, codes, main }) {
  /** @type {Record<string, any>} */
  const found = {};
  const search = (/** @type {any} */ value) => {
    for (const [name, inner] of Object.entries(value ?? {})) {
      if (inner && typeof inner === "object") search(inner);
      else found[name] ??= inner;
    }
  };
  search(codes?.["error"]?.params);
  const [, fileInText, lineInText, columnInText] = /([\w.-]+\.\w+)?:(\d+):(\d+)\b/.exec(error ?? "") ?? [];
  const line = Number(found["line"] ?? lineInText);
  const column = Number(found["column"] ?? columnInText);
  const named = [found["file"], found["name"], fileInText].find((name) => typeof name === "string" && name.includes("."));
  return line >= 1 && !error?.includes(`line ${line}`) ? { file: named ?? main ?? "", line, column: column >= 1 ? column : null } : null;
}
