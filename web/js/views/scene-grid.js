/** The scenes of the front page: the latest ones, and search results among all. */

import { findScenes } from "../news/api.js";
import { h, keyedList, setText } from "../base/dom.js";
import { hidden } from "../news/farm.js";
import { announce } from "../shell/tray.js";
import { t, tn } from "../base/words.js";
import { arrivingCard, sceneCard } from "./scene-card.js";

/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../news/arriving.js").Arriving} Arriving */

/** Number of scenes shown at first, so that the sections below stay reachable. */
const FIRST = 24;
/** Number of scenes from which a search field is shown. */
const SEARCHED = 9;
const TYPING_MS = 200;

/** @returns {{element: HTMLElement, aside: HTMLElement, put: (scenes: Scene[], uploads?: readonly Arriving[]) => void}} aside: shown beside the section's title */
export function sceneGrid() {
  /** The latest scenes known to the page. @type {Scene[]} */
  let latest = [];
  /** Uploads in progress, shown first. @type {readonly Arriving[]} */
  let coming = [];
  /** Further scenes of the service. @type {Map<string, Scene>} */
  const others = new Map();
  let isWhole = false;
  const grid = h("ul", { class: "cards" });
  const show = keyedList(
    grid,
    (/** @type {Scene | Arriving} */ { id }) => id,
    (item) => /** @type {import("../base/dom.js").Row<Scene | Arriving>} */ ("fraction" in item ? arrivingCard(item) : sceneCard(item)),
  );
  const search = h("input", { type: "search", placeholder: t("Search scenes"), "aria-label": t("Search scenes"), autocomplete: "off", hidden: true });
  const more = h("button", { class: "button", type: "button" }, t("Show all scenes"));
  const none = h("p", { class: "quiet", hidden: true });
  const rest = h("div", { class: "row more-scenes", hidden: true }, more);
  const words = () => search.value.toLowerCase().split(/\s+/).filter(Boolean);
  const refresh = () => {
    const known = new Set(latest.map(({ id }) => id));
    const all = [...latest, ...[...others.values()].filter(({ id }) => !known.has(id) && !hidden.value.has(id))];
    const sought = words();
    const found = all.filter(({ name, id }) => sought.every((word) => name.toLowerCase().includes(word) || id.startsWith(word)));
    const shown = isWhole || sought.length ? found : found.slice(0, FIRST);
    show([...coming, ...shown]);
    search.hidden = all.length < SEARCHED && !search.value;
    rest.hidden = shown.length === found.length;
    none.hidden = found.length > 0 || sought.length === 0;
    setText(none, t("No scene has that name."));
    return found.length;
  };
  /** @param {string} text empty: all of them */
  const ask = async (text) => {
    try {
      for (const scene of await findScenes(text)) others.set(scene.id, scene);
    } catch {
      return; // known scenes stay; the banner shows that the service does not respond
    }
    if (text === search.value.trim()) announce(tn(refresh(), "{n} scene", "{n} scenes"));
  };
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let typing;
  search.addEventListener("input", () => {
    clearTimeout(typing);
    refresh();
    typing = setTimeout(() => words().length && void ask(search.value.trim()), TYPING_MS);
  });
  more.addEventListener("click", async () => {
    isWhole = true;
    const next = grid.children.length; // the first of those that were not shown
    await ask("");
    refresh();
    grid.children[next]?.querySelector("a")?.focus(); // the button has disappeared
  });
  return {
    element: h("div", null, grid, none, rest),
    aside: search,
    put(scenes, uploads = []) {
      latest = scenes;
      coming = uploads;
      refresh();
    },
  };
}
