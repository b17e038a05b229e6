/** The list of jobs: searched, filtered and sorted by the service, with the filter in the URL. */

import { fill, h, setText } from "../base/dom.js";
import { hidden, scenes, workers } from "../news/farm.js";
import { JobList } from "../news/job-list.js";
import { count } from "../base/format.js";
import { chosenProject } from "../base/project.js";
import { mayChange, offer } from "../news/projects.js";
import { session } from "../news/session.js";
import { freshId } from "../forms/fields.js";
import { emptyState, noWorkerNotice } from "../shell/hints.js";
import { here, linkTo, onParams, setParams, setTitle } from "../shell/router.js";
import { Disposer } from "../base/store.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { jobRow } from "./job-row.js";
import { Selection, selectionBar } from "./selection.js";
import { virtualRows } from "./virtual-rows.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").JobState} JobState */

/** @type {[string, string, JobState[]][]} */
const FILTERS = [
  ["all", t("All"), []],
  ["active", t("Active"), ["queued", "running", "paused"]],
  ["finished", t("Finished"), ["finished"]],
  ["failed", t("Failed"), ["failed"]],
  ["cancelled", t("Cancelled"), ["cancelled"]],
];

const SORTS = [
  ["newest", t("Newest first")],
  ["oldest", t("Oldest first")],
  ["name", t("Name")],
  ["priority", t("Priority")],
  ["state", t("State")],
];
const KINDS = [
  ["", t("Stills and shots")],
  ["false", t("Stills")],
  ["true", t("Shots")],
];
const TYPING_MS = 200;

/** @returns {{element: HTMLElement, dispose: () => void}} */
export function jobsView() {
  setTitle(t("Jobs"));
  const life = new Disposer();
  const notice = h("div", { class: "notice-slot" });
  const empty = h("div", null);
  const said = h("p", { class: "visually-hidden", role: "status" });

  const search = h("input", { type: "search", placeholder: t("Search names, descriptions and scenes"), "aria-label": t("Search jobs"), autocomplete: "off" });
  const sort = choice(t("Order"), SORTS);
  const kind = choice(t("Kind"), KINDS);
  const scene = choice(t("Scene"), [["", t("All scenes")]]);
  const tabs = FILTERS.map(([key, label, states]) => {
    const tally = h("span", { class: "number" });
    const button = h("button", { type: "button", onclick: () => turnTo({ show: key === "all" ? null : key }) }, label, " ", tally);
    return { key, states, button, tally };
  });

  const list = new JobList(() => refresh());
  life.add(() => list.dispose());
  const selection = new Selection(() => refresh());
  const bar = selectionBar(selection, (id) => list.rows.get(id));
  const rows = virtualRows((id) => selectableRow(id, list, selection), life);

  /** @param {Record<string, string | null>} changes */
  const turnTo = (changes) => {
    setParams(changes);
    look();
  };
  const look = () => {
    const { params } = here();
    const filter = FILTERS.find(([key]) => key === params.get("show")) ?? FILTERS[0];
    for (const { key, button } of tabs) button.setAttribute("aria-pressed", String(key === filter?.[0]));
    if (document.activeElement !== search) search.value = params.get("search") ?? "";
    sort.value = params.get("sort") ?? "newest";
    kind.value = params.get("shot") ?? "";
    offerScenes();
    selection.clear();
    void list.ask({
      ...(filter?.[2].length ? { state: filter[2] } : {}),
      ...Object.fromEntries(["search", "sort", "shot", "scene"].flatMap((name) => (params.get(name) ? [[name, params.get(name)]] : []))),
    });
  };
  const offerScenes = () => {
    const chosen = here().params.get("scene") ?? "";
    const offered = [["", t("All scenes")], ...(scenes.value ?? []).map(({ id, name }) => [id, name])];
    if (!offered.some(([id]) => id === chosen)) offered.push([chosen, t("A deleted scene")]);
    fill(scene, ...offered.map(([value, label]) => h("option", { value }, label ?? "")));
    scene.value = chosen;
  };

  // On a phone the choices are folded, since they would take three rows; those made are shown.
  const fold = h("button", { class: "button fold", type: "button", "aria-expanded": "false", onclick: () => unfold(fold.getAttribute("aria-expanded") !== "true") }, t("Filters"));
  const choices = h("div", { class: "list-choices" }, search, fold, scene, kind, sort);
  const unfold = (/** @type {boolean} */ isOpen) => {
    fold.setAttribute("aria-expanded", String(isOpen));
    choices.classList.toggle("folded", !isOpen);
  };
  const tools = h(
    "div",
    { class: "list-tools" },
    h("div", { class: "tabs", role: "group", "aria-label": t("Show") }, tabs.map(({ button }) => button)),
    choices,
  );
  const shownIds = () => (list.ids ?? []).filter((id) => !hidden.value.has(id));
  const refresh = () => {
    const any = Object.values(list.tallies).some((n) => n > 0);
    const ids = shownIds();
    selection.among(ids);
    for (const { states, tally } of tabs) {
      const of = Object.entries(list.tallies).filter(([state]) => !states.length || states.includes(/** @type {JobState} */ (state)));
      const n = of.reduce((sum, [, each]) => sum + each, 0);
      setText(tally, list.ids ? count(n) : "");
      tally.classList.toggle("none", n === 0);
    }
    rows.element.hidden = ids.length === 0; // before layout, since hidden rows have no height
    rows.show(ids);
    bar.update();
    if (list.ids) setText(said, tn(ids.length, "{n} job", "{n} jobs"));
    tools.hidden = Boolean(list.ids) && !any && !here().params.get("search");
    if (list.error && !list.ids) fill(empty, emptyState("warning", t("The jobs cannot be listed"), h("p", null, list.error)));
    else if (!list.ids || ids.length) fill(empty);
    else if (any || here().params.get("search")) fill(empty, emptyState("image", t("No job matches"), again(turnTo)));
    else fill(empty, noJobs());
  };

  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let typing;
  search.addEventListener("input", () => {
    clearTimeout(typing);
    typing = setTimeout(() => turnTo({ search: search.value.trim() || null }), TYPING_MS);
  });
  life.add(() => clearTimeout(typing));
  sort.addEventListener("change", () => turnTo({ sort: sort.value === "newest" ? null : sort.value }));
  kind.addEventListener("change", () => turnTo({ shot: kind.value || null }));
  scene.addEventListener("change", () => turnTo({ scene: scene.value || null }));

  unfold(["scene", "shot", "sort"].some((name) => here().params.has(name)));
  list.follow();
  life.add(onParams(look));
  life.add(hidden.subscribe(() => refresh()));
  life.add(scenes.subscribe(offerScenes));
  life.add(workers.subscribe((all) => fill(notice, all?.length === 0 && noWorkerNotice())));
  /** @param {number} by */
  const step = (by) => {
    const at = Number(document.activeElement?.closest("[aria-posinset]")?.getAttribute("aria-posinset") ?? 0) - 1;
    rows.focus(Math.min(Math.max(at < 0 ? 0 : at + by, 0), shownIds().length - 1));
  };
  const isFree = mayChange(chosenProject()); // without permission to change there is nothing to select for
  const selecting = [
    { keys: "X", does: t("Select the focused job"), run: () => selection.toggleFocused() },
    { keys: "Ctrl+A", does: t("Select all listed"), run: () => {} },
    { keys: "Escape", does: t("Select none"), run: () => selection.clear() },
    { keys: "Delete", does: t("Delete the selection"), run: () => bar.remove() },
  ];
  life.add(
    addShortcuts([
      { keys: "/", does: t("Search"), run: () => search.focus() },
      { keys: "ArrowDown", shown: "↓", does: t("Next job"), run: () => step(1) },
      { keys: "ArrowUp", shown: "↑", does: t("Previous job"), run: () => step(-1) },
      ...(isFree ? selecting : []),
    ]),
  );
  life.listen(document, "keydown", (/** @type {KeyboardEvent} */ event) => {
    const typed = event.target instanceof HTMLElement && event.target.matches("input[type=search], input[type=number], textarea, dialog *");
    if (!isFree || !(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "a" || typed) return;
    event.preventDefault();
    selection.all();
  });

  const element = h(
    "div",
    { class: `page jobs-page ${session.value.kind === "open" ? "of-no-users" : ""}` },
    h("h1", { class: "page-title" }, t("Jobs")),
    tools,
    notice,
    bar.element,
    // Rows are list items that contain their labels for screen readers; the column heads are visual only.
    h("div", { class: "list-head", "aria-hidden": "true" }, ["", t("Picture"), t("Name"), t("Status"), t("Progress, time"), t("Samples"), t("By"), t("Age"), ""].map((head) => h("span", null, head))),
    rows.element,
    empty,
    said,
  );
  offer(element, chosenProject());
  look();
  return { element, dispose: () => life.dispose() };
}

/**
 * @param {string} label
 * @param {string[][]} options value, label
 */
function choice(label, options) {
  return h("select", { "aria-label": label, id: freshId("choice") }, ...options.map(([value, text]) => h("option", { value }, text ?? "")));
}

/** @param {(changes: Record<string, null>) => void} turnTo */
function again(turnTo) {
  const all = { show: null, search: null, scene: null, shot: null };
  return h("button", { class: "text-button", type: "button", onclick: () => turnTo(all) }, t("Show all jobs"));
}

function noJobs() {
  const about = t("Open a scene, press Render, and its picture appears here. ");
  return emptyState("image", t("No pictures yet"), h("p", null, about, h("a", { href: linkTo() }, t("To the scenes"))));
}

/**
 * @param {string} id
 * @param {JobList} list
 * @param {Selection} selection
 * @returns {import("../base/dom.js").Row<string>}
 */
function selectableRow(id, list, selection) {
  const box = h("input", { type: "checkbox", "data-job": id });
  const pick = h("label", { class: "pick" }, box);
  const element = h("li", { class: "job-row unknown" });
  /** @type {import("../base/dom.js").Row<import("../base/types.js").Job> | null} */
  let row = null;
  pick.addEventListener("click", (event) => {
    if (event.target !== box) return; // a label's click, which its checkbox receives too
    selection.pick(id, event.shiftKey, true);
  });
  element.addEventListener("click", (event) => {
    const onLink = event.target instanceof HTMLElement && event.target.matches("a.name");
    if (!onLink || !(event.shiftKey || event.ctrlKey || event.metaKey)) return;
    event.preventDefault();
    selection.pick(id, event.shiftKey, event.ctrlKey || event.metaKey);
  });
  return {
    element,
    update() {
      const job = list.row(id);
      const chosen = selection.has(id);
      box.checked = chosen;
      element.classList.toggle("chosen", chosen);
      if (!job) return;
      if (!row) {
        row = jobRow(job, pick);
        element.classList.remove("unknown");
        element.append(...row.element.children);
      }
      box.setAttribute("aria-label", t("Select {name}", { name: job.name }));
      row.update(job);
      offer(element, job.project);
    },
  };
}
