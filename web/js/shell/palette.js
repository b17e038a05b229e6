/** The command palette: actions on the picture that is shown, pages, scenes, jobs and other actions, found by their names. Ctrl+K opens it. */

import { findJobs, findScenes, getExamples, getGuides } from "../news/api.js";
import { fill, h } from "../base/dom.js";
import { hidden, jobs, scenes } from "../news/farm.js";
import { visitExample } from "./examples.js";
import { showHelp } from "./help-dialog.js";
import { icon } from "../base/icons.js";
import { LAYOUTS, layoutCommands } from "./layouts.js";
import { linkTo } from "./router.js";
import { session } from "../news/session.js";
import { shortcuts } from "./shortcuts.js";
import { THEMES, chooseTheme } from "./theme-button.js";
import { announce } from "./tray.js";
import { LANGUAGES, language, speak, t, tn } from "../base/words.js";

/** @typedef {import("../base/icons.js").IconName} IconName */
/** @typedef {{group: string, symbol: IconName, label: string, note?: string, run: () => void}} Command */

export const PALETTE_KEYS = "Ctrl+K";
const MOST = 7; // scenes, and jobs
const TYPING_MS = 200;

const [PICTURE, PAGES, ACTIONS, SCENES, JOBS, EXAMPLES, GUIDES] = [t("This picture"), t("Pages"), t("Actions"), t("Scenes"), t("Jobs"), t("Examples"), t("Guides")];

/**
 * Returns the entries whose label or note has every word, those that begin with the text first.
 *
 * @template {{label: string, note?: string}} T
 * @param {T[]} entries
 * @param {string} text
 * @returns {T[]}
 */
export function matching(entries, text) {
  const words = text.toLowerCase().split(/\s+/).filter(Boolean);
  const begins = (/** @type {T} */ { label }) => label.toLowerCase().startsWith(words[0] ?? "");
  const found = entries.filter(({ label, note = "" }) => words.every((word) => `${label} ${note}`.toLowerCase().includes(word)));
  return [...found.filter(begins), ...found.filter((entry) => !begins(entry))];
}

/** @param {string} hash @returns {() => void} */
const visit = (hash) => () => {
  location.hash = hash;
};
/** @param {string} path @returns {() => void} */
const leave = (path) => () => location.assign(path);

/** @param {readonly (readonly [string, string])[]} nav the sections: label, path @returns {Command[]} */
function pages(nav) {
  return [
    ...nav.map(([label, path]) => ({ group: PAGES, symbol: /** @type {IconName} */ ("next"), label, run: visit(path ? linkTo(path) : linkTo()) })),
    ...(session.value.login ? [{ group: PAGES, symbol: /** @type {IconName} */ ("person"), label: t("Account"), run: visit(linkTo("account")) }] : []),
    { group: PAGES, symbol: "info", label: t("Guides"), run: leave("docs/guides/") },
    { group: PAGES, symbol: "info", label: t("API documentation"), run: leave("docs/") },
    { group: PAGES, symbol: "info", label: t("Help"), run: showHelp },
  ];
}

/** Returns the actions that have keys: those on the picture that is shown, or all others. @param {boolean} ofPicture @returns {Command[]} */
function keyed(ofPicture) {
  const listed = shortcuts().filter(({ keys, shown, group }) => shown !== null && keys !== PALETTE_KEYS && keys !== "?" && (group === "picture") === ofPicture);
  return listed.map(({ keys, shown, does, run }) => ({ group: ofPicture ? PICTURE : ACTIONS, symbol: "play", label: does, note: shown ?? keys, run }));
}

/** Returns the actions that have keys, except those on the picture, the themes, and the other languages. @returns {Command[]} */
function actions() {
  const themes = THEMES.map(([name, symbol, label]) => ({ group: ACTIONS, symbol, label, run: () => chooseTheme(name) }));
  const others = LANGUAGES.filter(([name]) => name !== language);
  const languages = others.map(([name, own]) => ({ group: ACTIONS, symbol: /** @type {IconName} */ ("globe"), label: own, note: t("Language"), run: () => speak(name) }));
  return [...keyed(false), ...themes, ...languages];
}

/** Examples that are no scenes yet, and sections of the guides, once they are loaded. @type {Record<string, Command[]>} */
const further = {};

/** Loads the examples and the guides, which only searches need. @param {() => void} came called after each */
function loadFurther(came) {
  const load = async (/** @type {string} */ group, /** @type {Promise<Command[]>} */ found) => {
    further[group] = await found.catch(() => further[group] ?? []); // the palette finds the rest without them
    came();
  };
  void load(EXAMPLES, getExamples().then((all) => all.filter((each) => each.scenes.length === 0).map((each) => ({ group: EXAMPLES, symbol: "cube", label: each.title, run: () => void visitExample(each) }))));
  void load(GUIDES, getGuides().then((all) => all.map(({ guide, heading, url }) => ({ group: GUIDES, symbol: "info", label: heading, note: heading === guide ? "" : guide, run: leave(url) }))));
}

/** Unites known items with those that the service has found. @template {{id: string}} T @param {T[] | null} known @param {T[]} found */
function united(known, found) {
  const ids = new Set(known?.map(({ id }) => id));
  return [...(known ?? []), ...found.filter(({ id }) => !ids.has(id))].filter(({ id }) => !hidden.value.has(id));
}

/**
 * Opens the palette.
 *
 * @param {readonly (readonly [string, string])[]} nav the sections: label, path
 */
export function showPalette(nav) {
  if (document.querySelector("dialog[open]")) return;
  const fixed = [...keyed(true), ...pages(nav), ...actions(), ...layoutCommands()];
  /** @type {{scenes: import("../base/types.js").Scene[], jobs: import("../base/types.js").Job[]}} */
  const found = { scenes: [], jobs: [] };
  /** @type {Command[]} */
  let shown = [];
  let at = 0;
  const list = h("div", { class: "palette-list", id: "palette-list", role: "listbox", "aria-label": t("Results") });
  const none = h("p", { class: "quiet palette-none", hidden: true }, t("Nothing found"));
  const input = h("input", {
    ...{ type: "text", role: "combobox", autocomplete: "off", spellcheck: "false", placeholder: t("Find scenes, jobs, actions") },
    ...{ "aria-label": t("Find scenes, jobs, actions"), "aria-expanded": "true", "aria-controls": "palette-list", "aria-autocomplete": "list" },
  });

  const mark = () => {
    [...list.querySelectorAll("[role=option]")].forEach((element, i) => {
      element.setAttribute("aria-selected", String(i === at));
      if (i === at) element.scrollIntoView({ block: "nearest" });
    });
    if (shown.length) input.setAttribute("aria-activedescendant", `palette-${at}`);
    else input.removeAttribute("aria-activedescendant");
  };
  /** @param {Command | undefined} command */
  const choose = (command) => {
    if (!command) return;
    dialog.close();
    command.run();
  };
  const refresh = () => {
    const text = input.value.trim();
    const ofScenes = united(scenes.value, found.scenes).map(({ id, name }) => ({ label: name, group: SCENES, symbol: /** @type {IconName} */ ("cube"), run: visit(linkTo("scenes", id)) }));
    const ofJobs = united(jobs.value, found.jobs).map(({ id, name, note, spp, width, height }) => ({
      ...{ label: name, group: JOBS, symbol: /** @type {IconName} */ ("image"), run: visit(linkTo("jobs", id)) },
      note: [width && height ? `${width}×${height}` : "", spp ? `${spp} spp` : "", note ?? ""].filter(Boolean).join(" · "),
    }));
    shown = [...matching(fixed, text), ...matching(ofScenes, text).slice(0, MOST), ...matching(ofJobs, text).slice(0, MOST), ...(text ? [EXAMPLES, GUIDES].flatMap((group) => matching(further[group] ?? [], text).slice(0, MOST)) : [])];
    const isLast = (/** @type {Command} */ { group }) => group === ACTIONS || group === LAYOUTS;
    if (!text) shown = [...shown.filter((each) => !isLast(each)), ...shown.filter(isLast)];
    at = Math.min(at, Math.max(shown.length - 1, 0));
    const groups = [...new Set(shown.map(({ group }) => group))];
    fill(
      list,
      groups.map((group) =>
        h(
          "div",
          { role: "group", "aria-label": group },
          h("div", { class: "palette-group", "aria-hidden": "true" }, group),
          shown.map((command, i) =>
            command.group === group &&
            h(
              "div",
              { class: "palette-option", role: "option", id: `palette-${i}`, onclick: () => choose(command), onpointermove: () => at !== i && ((at = i), mark()) },
              icon(command.symbol),
              h("span", { class: "palette-label" }, command.label),
              command.note && h("span", { class: "quiet small palette-note" }, command.note),
            ),
          ),
        ),
      ),
    );
    none.hidden = shown.length > 0;
    mark();
  };
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let typing;
  const ask = async () => {
    const text = input.value.trim();
    if (text) {
      const [more, others] = await Promise.all([findScenes(text).catch(() => []), findJobs(text, MOST).catch(() => [])]);
      if (!dialog.open || text !== input.value.trim()) return;
      [found.scenes, found.jobs] = [more, others];
      refresh();
    }
    announce(tn(shown.length, "{n} result", "{n} results"));
  };
  input.addEventListener("input", () => {
    at = 0;
    refresh();
    clearTimeout(typing);
    typing = setTimeout(ask, TYPING_MS);
  });
  input.addEventListener("keydown", (event) => {
    const step = { ArrowDown: 1, ArrowUp: -1 }[event.key];
    if (step && shown.length) at = (at + step + shown.length) % shown.length;
    else if (event.key === "Enter") choose(shown[at]);
    else return;
    event.preventDefault();
    if (step) mark();
  });
  const dialog = h(
    "dialog",
    {
      ...{ class: "palette", "aria-label": t("Find") },
      onclick: (/** @type {MouseEvent} */ event) => event.target === dialog && dialog.close(),
      onclose: () => (clearTimeout(typing), dialog.remove()),
    },
    input,
    list,
    none,
  );
  document.body.append(dialog);
  dialog.showModal();
  refresh();
  input.focus();
  loadFurther(() => dialog.open && refresh());
}

/** Opens and closes the palette by Ctrl+K or, on a Mac, Command+K. @param {readonly (readonly [string, string])[]} nav */
export function listenForPalette(nav) {
  addEventListener("keydown", (event) => {
    if (!(event.ctrlKey || event.metaKey) || event.altKey || event.shiftKey || event.key.toLowerCase() !== "k") return;
    event.preventDefault(); // the browser's search field
    const open = /** @type {HTMLDialogElement | null} */ (document.querySelector("dialog.palette[open]"));
    if (open) open.close();
    else showPalette(nav);
  });
}
