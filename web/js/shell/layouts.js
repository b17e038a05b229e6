/**
 * Layouts: the tab and the sections that are open beside a picture, the width of that side, the strips below a scene's view, and how
 * pictures are displayed. They are saved under names in this browser, and are entries of the command palette.
 */

import { h } from "../base/dom.js";
import { Store } from "../base/store.js";
import { t } from "../base/words.js";
import { announce } from "./tray.js";

/**
 * @typedef {object} Frame the side beside a picture, and the strips below a scene's view
 * @property {number | null} width of the side in pixels; null: the usual one
 * @property {boolean} hasSide
 * @property {boolean} hasStrips
 *
 * @typedef {Record<string, any>} Layout values by the names of parts; `frame` and `folds` are those of this module
 *
 * @typedef {object} Part of a page, which a layout sets
 * @property {() => any} get JSON
 * @property {(value: any) => void} set what `get` returned, perhaps on another page
 */

const [FRAME_KEY, LAYOUTS_KEY] = ["rayfarm-frame", "rayfarm-layouts"];
/** Least and greatest width of the side, in pixels, and the step of its arrow keys. */
const [LEAST, MOST, STEP] = [288, 720, 16];
/** Width of the side in pixels, as css/tokens.css has it on a wide screen. */
const USUAL_WIDTH = 360;
/** @type {Frame} */
const USUAL = { width: null, hasSide: true, hasStrips: true };
/** @type {Layout} */
const DEFAULT = { frame: USUAL, folds: {}, tab: "view", display: { exposure: null, curve: "", channel: "" } }; // null: the page's or the job's own exposure and curve

/** @param {string} key @returns {any} null: none, or storage is blocked */
function read(key) {
  try {
    return JSON.parse(localStorage.getItem(key) ?? "null");
  } catch {
    return null;
  }
}

/** @param {string} key @param {unknown} value */
function write(key, value) {
  try {
    localStorage.setItem(key, JSON.stringify(value));
  } catch {
    // Storage is blocked: it lasts until the page is closed.
  }
}

/** @param {any} value from storage @returns {Record<string, any>} */
function recordFrom(value) {
  return value !== null && typeof value === "object" && !Array.isArray(value) ? value : {};
}

/** @param {any} value @returns {Frame} */
const frameFrom = (value) => ({
  width: Number.isFinite(value?.width) ? Math.min(Math.max(value.width, LEAST), MOST) : null,
  hasSide: value?.hasSide !== false,
  hasStrips: value?.hasStrips !== false,
});

/** @type {Store<Frame>} */
const frame = new Store(frameFrom(read(FRAME_KEY)));
/** The saved layouts by name. @type {Record<string, Layout>} */
let saved = recordFrom(read(LAYOUTS_KEY));

/** Shows the frame on the page, and keeps it. */
export function followFrame() {
  const root = document.documentElement;
  frame.subscribe((now) => {
    root.style.setProperty("--side-chosen", now.width === null ? "" : `${now.width}px`);
    root.classList.toggle("chosen-side", now.width !== null);
    root.classList.toggle("without-side", !now.hasSide);
    root.classList.toggle("without-strips", !now.hasStrips);
    write(FRAME_KEY, now);
  });
}

/** Parts of the open page by name. @type {Map<string, Part>} */
const parts = new Map();
/** Values of the latest layout for parts that have not been on a page since. @type {Map<string, any>} */
const awaited = new Map();

/**
 * Adds a part of the page, which a layout that was chosen elsewhere then sets.
 *
 * @param {string} name
 * @param {Part} part
 * @returns {() => void} removes it
 */
export function addPart(name, part) {
  parts.set(name, part);
  if (awaited.has(name)) part.set(awaited.get(name));
  awaited.delete(name);
  return () => {
    if (parts.get(name) === part) parts.delete(name);
  };
}

const FOLDS = "details[data-fold]";

/** Includes in layouts whether a section is open. @template {HTMLDetailsElement} T @param {string} name @param {T} details @returns {T} */
export function withFold(name, details) {
  details.dataset.fold = name;
  /** @type {Record<string, boolean> | undefined} */
  const folds = awaited.get("folds");
  if (folds && name in folds) details.open = Boolean(folds[name]);
  return details;
}

/** @returns {HTMLDetailsElement[]} */
const folds = () => [...document.querySelectorAll(FOLDS)].filter((element) => element instanceof HTMLDetailsElement);

/** @returns {Layout} of the open page */
export function layoutNow() {
  const ofParts = [...parts].map(([name, part]) => [name, part.get()]);
  return { frame: frame.value, folds: Object.fromEntries(folds().map(({ dataset, open }) => [dataset.fold, open])), ...Object.fromEntries(ofParts) };
}

/** Applies a layout to the open page, and the parts that this page lacks to pages that are opened later. @param {Layout} layout */
export function applyLayout({ frame: framed, folds: stored, ...values }) {
  const open = recordFrom(stored);
  frame.set(frameFrom(framed));
  for (const element of folds()) element.open = Boolean(open[element.dataset.fold ?? ""]);
  awaited.set("folds", open);
  for (const [name, value] of Object.entries(values)) {
    const part = parts.get(name);
    if (part) part.set(value);
    else if (name !== "display") awaited.set(name, value); // the display of a picture is its link's
  }
}

/** @param {string} name @param {Layout | null} layout null: deletes it */
function keep(name, layout) {
  const { [name]: _, ...others } = saved;
  saved = layout ? { ...others, [name]: layout } : others;
  write(LAYOUTS_KEY, saved);
}

/** Asks for a name, and saves the layout of the open page. */
export function saveLayout() {
  const layout = layoutNow();
  const name = h("input", { type: "text", id: "layout-name", required: true, maxlength: 40, autocomplete: "off" });
  const dialog = h(
    "dialog",
    { class: "help which", "aria-label": t("Save layout"), onclose: () => dialog.remove() },
    h(
      "form",
      {
        class: "help-body stack",
        method: "dialog",
        onsubmit: () => {
          const given = name.value.trim();
          if (!given) return;
          keep(given, layout);
          announce(t("Layout {name} saved", { name: given }));
        },
      },
      h("h2", null, t("Save layout")),
      h("div", { class: "field" }, h("label", { for: name.id }, t("Name")), name),
      h("p", { class: "quiet small" }, t("The sidebar, its open tab and sections, the strips, exposure, tone curve and channel. Ctrl+K finds it.")),
      h("div", { class: "row" }, h("button", { class: "button primary", type: "submit" }, t("Save")), h("button", { class: "button", type: "button", onclick: () => dialog.close() }, t("Cancel"))),
    ),
  );
  document.body.append(dialog);
  dialog.showModal();
  name.focus();
}

export const LAYOUTS = t("Layouts");

/** @returns {import("./palette.js").Command[]} for the command palette */
export function layoutCommands() {
  /** @param {string} label @param {() => void} run @returns {import("./palette.js").Command} */
  const command = (label, run) => ({ group: LAYOUTS, symbol: "screen", label, run });
  const names = Object.keys(saved).sort((a, b) => a.localeCompare(b));
  const { hasSide, hasStrips } = frame.value;
  return [
    ...names.map((name) => command(t("Layout: {name}", { name }), () => applyLayout(saved[name] ?? DEFAULT))),
    command(t("Layout: {name}", { name: t("Default") }), () => applyLayout(DEFAULT)),
    command(t("Save layout …"), saveLayout),
    command(hasSide ? t("Hide the sidebar") : t("Show the sidebar"), () => frame.update((now) => ({ ...now, hasSide: !hasSide }))),
    command(hasStrips ? t("Hide the strips of takes and pictures") : t("Show the strips of takes and pictures"), () => frame.update((now) => ({ ...now, hasStrips: !hasStrips }))),
    ...names.map((name) => command(t("Delete layout: {name}", { name }), () => (keep(name, null), announce(t("Layout {name} deleted", { name }))))),
  ];
}

/**
 * The edge between a picture and its side: dragging it, or arrow keys, change the side's width; Enter and a double-click hide the side, or show it.
 *
 * @param {() => HTMLElement} side
 * @param {import("../base/store.js").Disposer} life
 * @returns {HTMLElement}
 */
export function sideEdge(side, life) {
  const toggle = () => frame.update((now) => ({ ...now, hasSide: !now.hasSide }));
  const edge = h("div", {
    class: "side-edge",
    role: "separator",
    tabindex: "0",
    "aria-orientation": "vertical",
    "aria-label": t("Sidebar width"),
    title: t("Drag to change the width; double-click to hide or show the sidebar"),
    ...{ "aria-valuemin": 0, "aria-valuemax": MOST },
    ondblclick: toggle,
  });
  const widen = (/** @type {number} */ width) => frame.update((now) => ({ ...now, hasSide: true, width: Math.round(Math.min(Math.max(width, LEAST), MOST)) }));
  edge.addEventListener("pointerdown", (event) => {
    if (event.button) return;
    edge.setPointerCapture(event.pointerId);
    event.preventDefault();
    edge.focus({ preventScroll: true });
    const [from, width] = [event.clientX, frame.value.hasSide ? side().getBoundingClientRect().width : 0];
    const end = new AbortController();
    const { signal } = end;
    edge.addEventListener("pointermove", ({ clientX }) => Math.abs(clientX - from) > 2 && widen(width + from - clientX), { signal });
    for (const type of ["pointerup", "pointercancel"]) edge.addEventListener(type, () => end.abort(), { signal });
  });
  edge.addEventListener("keydown", (event) => {
    const step = { ArrowLeft: STEP, ArrowRight: -STEP }[event.key];
    if (event.key !== "Enter" && step === undefined) return;
    event.preventDefault();
    event.stopPropagation();
    if (step === undefined) toggle();
    else widen(side().getBoundingClientRect().width + step);
  });
  life.add(frame.subscribe(({ width, hasSide }) => edge.setAttribute("aria-valuenow", String(hasSide ? (width ?? USUAL_WIDTH) : 0))));
  return edge;
}
