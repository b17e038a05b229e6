/** The takes of a scene: a strip with a picture for each, which restores its camera and settings; and the button that saves one. */

import { h, keyedList, setText } from "../base/dom.js";
import { ago } from "../base/format.js";
import { icon } from "../base/icons.js";
import { Disposer } from "../base/store.js";
import { t } from "../base/words.js";
import { noteAuthor } from "../job/note-author.js";
import { showImage } from "../news/images.js";
import { mayChange } from "../news/projects.js";
import * as api from "../news/takes.js";
import { here, onParams, setParams } from "../shell/router.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { hadTakes, noteTakes } from "./had-takes.js";
import { announce, showError, undoable } from "../shell/tray.js";

/** @typedef {import("../base/types.js").Take} Take */
/** @typedef {Pick<Take, "request" | "exposure" | "tonemap">} TakeState */

const LONGEST_NAME = 100;
const TICK_MS = 30_000;

/**
 * @param {import("../base/types.js").Scene} scene
 * @param {object} view
 * @param {() => TakeState} view.state of the live view now
 * @param {() => string | null} view.picture what it shows now, as base64; null: nothing yet
 * @param {(state: TakeState) => void} view.restore shows a take
 */
export function takes(scene, { state, picture, restore }) {
  const life = new Disposer();
  const path = here().path.join();
  /** @type {Take[]} */
  let known = [];
  let isLoaded = false;
  const isExpected = hadTakes(scene.id);
  /** Takes that are being deleted. @type {Set<string>} */
  const leaving = new Set();
  /** The take that the view shows, and the view's state since then. @type {{id: string, state: string} | null} */
  let current = null;

  const save = h("button", { class: "button small for-submit", type: "button", title: t("Save the camera, light and settings as a take (T)"), "aria-label": t("Save take"), onclick: () => void keep() }, icon("keep"), h("span", { class: "view-word" }, t("Save take")));
  const name = noteAuthor();
  name.show();
  const list = h("ul", { class: "strip" });
  const element = h(
    "section",
    { class: "pictures takes", "aria-label": t("Takes"), hidden: true },
    h("div", { class: "row" }, h("h2", { class: "strip-title" }, t("Takes")), h("span", { class: "grow" }), h("div", { class: "takes-author for-submit" }, name.element)),
    list,
  );
  const rows = keyedList(list, (/** @type {Take} */ { id }) => id, () => tile({ choose, rename, remove, isCurrent: (id) => id === current?.id, mayChange: () => mayChange(scene.project) }));
  const show = () => {
    const shown = known.filter(({ id }) => !leaving.has(id));
    rows(shown);
    element.hidden = shown.length === 0 && (isLoaded || !isExpected);
    if (isLoaded) noteTakes(scene.id, known.length > 0);
  };
  const stateText = () => JSON.stringify(state());
  /** @param {string | null} id */
  const setCurrent = (id) => {
    current = id === null ? null : { id, state: stateText() };
    if (here().path.join() === path) setParams({ take: id });
    show();
  };

  /** @param {Take} take */
  const choose = (take) => {
    const before = current ? null : state();
    const said = t("{name} restored", { name: take.name });
    restore(take);
    setCurrent(take.id);
    if (before) undoable(said, { commit: () => {}, undo: () => here().path.join() === path && (restore(before), setCurrent(null)) });
    else announce(said);
  };
  /** Restores the take that the address names. */
  const follow = () => {
    const id = here().params.get("take");
    const take = known.find((each) => each.id === id);
    if (take && take.id !== current?.id && here().path.join() === path) choose(take);
  };

  let asked = 0;
  const load = async () => {
    const mine = ++asked;
    try {
      const found = await api.getTakes(scene.id);
      if (mine !== asked) return;
      const old = new Set(known.map(({ id }) => id));
      const added = isLoaded ? found.filter(({ id }) => !old.has(id)) : [];
      known = found;
      if (current && !found.some(({ id }) => id === current?.id)) setCurrent(null);
      for (const take of added) announce(take.author ? t("{author} saved {name}", { author: take.author, name: take.name }) : t("New take: {name}", { name: take.name }));
      const isFirst = !isLoaded;
      isLoaded = true;
      show();
      if (isFirst) follow();
    } catch (error) {
      if (!isLoaded) showError(t("The takes cannot be shown"), error, { ofPage: true });
    }
  };
  const keep = async () => {
    if (save.disabled || !mayChange(scene.project)) return;
    save.disabled = true;
    try {
      const seen = picture();
      const take = await api.addTake(scene.id, { name: unusedName(known), ...name.given(), ...state(), ...(seen && { picture: seen }) });
      if (!known.some(({ id }) => id === take.id)) known = [...known, take];
      setCurrent(take.id);
      list.scrollLeft = list.scrollWidth;
      element.scrollIntoView({ block: "nearest", behavior: matchMedia("(prefers-reduced-motion: reduce)").matches ? "instant" : "smooth" }); // below the view, of which it may be out of sight
      announce(t("{name} saved", { name: take.name }));
    } catch (error) {
      showError(t("The take was not saved"), error, { ofPage: true });
    } finally {
      save.disabled = false;
    }
  };
  /** @param {Take} take @param {string} next */
  const rename = async (take, next) => {
    known = known.map((each) => (each.id === take.id ? { ...each, name: next } : each));
    show();
    try {
      await api.renameTake(scene.id, take.id, next);
    } catch (error) {
      showError(t("The take was not renamed"), error, { ofPage: true });
      void load();
    }
  };
  /** @param {Take} take */
  const remove = (take) => {
    const hide = (/** @type {boolean} */ on) => (on ? leaving.add(take.id) : leaving.delete(take.id), show());
    hide(true);
    const commit = async () => {
      try {
        await api.deleteTake(scene.id, take.id);
        known = known.filter(({ id }) => id !== take.id);
        if (current?.id === take.id) setCurrent(null);
      } catch (error) {
        showError(t("The take was not deleted"), error, { ofPage: true });
      }
      hide(false);
    };
    undoable(t("{name} deleted", { name: take.name }), { commit: () => void commit(), undo: () => hide(false) });
  };

  life.add(onParams(follow));
  life.add(addShortcuts([{ keys: "T", does: t("Save a take"), run: () => void keep() }], "picture"));
  life.every(TICK_MS, show);
  show();
  return {
    element,
    save,
    load,
    /** Updates which take the view shows after it was changed. */
    changed() {
      if (current && stateText() !== current.state) setCurrent(null);
    },
    dispose: () => life.dispose(),
  };
}

/** @param {Take[]} known @returns {string} Take 1, or the next number that is free */
function unusedName(known) {
  const names = new Set(known.map(({ name }) => name));
  let n = known.length + 1;
  while (names.has(t("Take {n}", { n }))) n += 1;
  return t("Take {n}", { n });
}

/**
 * @param {object} deeds
 * @param {(take: Take) => void} deeds.choose
 * @param {(take: Take, name: string) => unknown} deeds.rename
 * @param {(take: Take) => void} deeds.remove
 * @param {(id: string) => boolean} deeds.isCurrent
 * @param {() => boolean} deeds.mayChange
 * @returns {import("../base/dom.js").Row<Take>}
 */
function tile({ choose, rename, remove, isCurrent, mayChange }) {
  /** @type {Take} */
  let latest;
  const image = h("img", { alt: "", hidden: true });
  image.addEventListener("load", () => (image.hidden = false));
  const button = h("button", { class: "strip-tile", type: "button", onclick: () => choose(latest) }, h("span", { class: "strip-picture" }, icon("camera"), image));
  const title = h("span", { class: "take-name" });
  const about = h("span", { class: "quiet small take-about" });
  const input = h("input", { type: "text", maxLength: LONGEST_NAME, hidden: true, spellcheck: "false", autocomplete: "off", "aria-label": t("Name of the take") });
  const words = h("div", { class: "take-words" }, title, input, about);
  words.addEventListener("click", () => input.hidden && choose(latest));
  const begin = () => {
    if (!mayChange()) return;
    input.value = latest.name;
    input.hidden = false;
    title.hidden = true;
    input.focus();
    input.select();
  };
  /** @param {boolean} isKept @param {boolean} hadFocus */
  const end = (isKept, hadFocus) => {
    if (input.hidden) return;
    const next = input.value.trim();
    input.hidden = true;
    title.hidden = false;
    if (hadFocus) button.focus();
    if (isKept && next && next !== latest.name) void rename(latest, next);
  };
  input.addEventListener("keydown", (event) => {
    event.stopPropagation(); // these keys have page-wide meanings too
    if (event.key !== "Enter" && event.key !== "Escape") return;
    event.preventDefault();
    end(event.key === "Enter", true);
  });
  input.addEventListener("blur", () => end(true, false));
  const tool = (/** @type {import("../base/icons.js").IconName} */ face, /** @type {() => void} */ run, kind = "") => h("button", { class: `icon-button small ${kind}`, type: "button", onclick: run }, icon(face));
  const tools = { rename: tool("pencil", begin, "for-submit"), link: tool("link", () => void copy()), remove: tool("trash", () => remove(latest), "danger for-submit") };
  const copy = async () => {
    const url = new URL(location.href);
    url.hash = `${url.hash.split("?")[0]}?take=${latest.id}`;
    await navigator.clipboard.writeText(url.href).then(() => announce(t("Copied")), () => {});
  };
  tools.link.hidden = !navigator.clipboard; // only on HTTPS and localhost
  const element = h("li", { class: "take" }, button, words, h("div", { class: "take-tools" }, Object.values(tools)));
  element.addEventListener("keydown", (event) => {
    if (event.key === "F2") begin();
    else if (event.key === "Delete" && mayChange()) remove(latest);
    else return;
    event.preventDefault();
    event.stopPropagation();
  });
  return {
    element,
    update(next) {
      if (next.picture && next.picture !== latest?.picture) void showImage(image, next.picture.replace(/^\//, "")).catch(() => (image.hidden = true));
      latest = next;
      const { name } = next;
      const said = [next.author, ago(next.created)].filter(Boolean).join(", ");
      setText(title, next.name);
      title.title = next.name;
      setText(about, said);
      about.title = said;
      button.setAttribute("aria-label", `${next.name}, ${said}`);
      button.setAttribute("aria-pressed", String(isCurrent(next.id)));
      for (const [key, label] of Object.entries({ rename: t("Rename {name}", { name }), link: t("Copy a link to {name}", { name }), remove: t("Delete {name}", { name }) })) {
        const each = tools[/** @type {keyof typeof tools} */ (key)];
        each.setAttribute("aria-label", label);
        each.title = key === "rename" ? t("Rename (F2)") : key === "link" ? t("Copy link") : t("Delete");
      }
    },
  };
}
