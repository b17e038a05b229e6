/** Two pictures beside each other at a wipe: two jobs, a job and its denoised copy, or planes of either. */

import { getJob } from "../news/api.js";
import { differenceTable, progressOf, sideChoice } from "../compare/compare-panel.js";
import { clampExposure, lookFields, lookFromUrl, lookParams, wipeFrom } from "../job/display-panel.js";
import { fill, h } from "../base/dom.js";
import { adoptJob, jobs } from "../news/farm.js";
import { emptyState } from "../shell/hints.js";
import { icon } from "../base/icons.js";
import { differences, sideNames } from "../compare/job-differences.js";
import { LiveFilm } from "../film/live-film.js";
import { compareWays, wayFrom } from "../compare/ways.js";
import { pictureStage } from "../film/picture-stage.js";
import { stageKeys } from "../job/render-keys.js";
import { followWithFrame, here, linkTo, setParams, setTitle } from "../shell/router.js";
import { compareFrames, frameOf } from "../shot/compare-frames.js";
import { isShot } from "../base/shot-words.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { Disposer, Store } from "../base/store.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/**
 * @typedef {object} Comparison
 * @property {string} a a job
 * @property {string} b
 * @property {string} left a channel of it
 * @property {string} right
 * @property {number | null} frame of a side that is a shot; null: its first
 * @property {number} wipe
 * @property {import("../compare/ways.js").Way} way
 * @property {number} exposure
 * @property {string} curve
 */

/**
 * @param {string} a a job's id
 * @param {string} [b] another's, or the same; left out: the latest one that it can be compared with
 * @returns {{element: HTMLElement, dispose: () => void}}
 */
export function compareView(a, b) {
  setTitle(t("Comparison"));
  const life = new Disposer();
  const element = h("div", { class: "job-page compare-page" });
  const instead = (/** @type {string} */ title, /** @type {string} */ sentence) =>
    fill(
      element,
      h(
        "div",
        { class: "page" },
        emptyState("compare", title, h("p", null, sentence), h("a", { href: linkTo("jobs") }, t("To the jobs"))),
      ),
    );
  const { params } = here();
  /** @type {Store<Comparison>} */
  const state = new Store({
    ...{ a, b: b ?? "", left: params.get("a") ?? "", right: params.get("b") ?? "" },
    frame: frameFrom(params.get("frame")),
    wipe: wipeFrom(params.get("wipe")),
    way: wayFrom(params.get("way")),
    ...lookFromUrl(params),
  });
  /** What is open, to be closed before the next. @type {{key: string, life: Disposer, update: (a: Job, b: Job) => void} | null} */
  let opened = null;
  life.add(() => opened?.life.dispose());

  /** @type {Set<string>} */
  const asked = new Set();
  const show = () => {
    const all = jobs.value;
    if (!all) return;
    if (!state.value.b) {
      const first = all.find(({ id }) => id === state.value.a);
      if (first) state.update((now) => ({ ...now, ...partnerOf(first, all) }));
    }
    const ids = [state.value.a, state.value.b].filter(Boolean);
    for (const id of ids) {
      if (asked.has(id) || all.some((job) => job.id === id)) continue;
      asked.add(id);
      getJob(id).then(adoptJob, (error) => instead(t("This picture is not here"), error.message));
    }
    const [first, second] = ids.map((id) => all.find((job) => job.id === id));
    if (!first || !second) return;
    if (!first.width || !second.width) {
      const waits = first.width ? second : first;
      instead(waits.name, waits.error ?? waits.message ?? t("Waits for its scene."));
      return;
    }
    const key = `${first.id} ${second.id}`;
    if (opened?.key !== key) {
      opened?.life.dispose();
      opened = { key, ...open(element, first, second, state) };
    }
    opened.update(first, second);
  };
  life.add(jobs.subscribe(show));
  life.add(
    state.subscribe(({ a, b }) => {
      if (b && opened && opened.key !== `${a} ${b}`) show();
    }),
  );
  life.add(rememberComparison(state));
  return { element, dispose: () => life.dispose() };
}

/**
 * What a picture is first compared with: the latest other one of its scene, else its own albedo.
 *
 * @param {Job} job
 * @param {Job[]} all newest first
 * @returns {Partial<Comparison>}
 */
function partnerOf(job, all) {
  const other = all.find(({ id, scene, samples }) => scene === job.scene && id !== job.id && samples > 0);
  return other ? { b: other.id } : { b: job.id, right: "albedo" };
}

/** @param {string | null} text as an address has it */
const frameFrom = (text) => (text && Number.isFinite(Number(text)) ? Number(text) : null);

/** @param {Store<Comparison>} state @returns {() => void} ends it */
function rememberComparison(state) {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const end = state.subscribe(({ a, b, left, right, frame, wipe, way, exposure, curve }) => {
    clearTimeout(timer);
    if (!b) return;
    timer = setTimeout(() => {
      setParams(
        {
          a: left || null,
          b: right || null,
          frame: frame === null ? null : String(frame),
          wipe: wipe === 0.5 ? null : wipe.toFixed(3),
          way: way === "wipe" ? null : way,
          ...lookParams({ exposure, curve }),
        },
        ["compare", a, b],
      );
    }, 300);
  });
  return () => (clearTimeout(timer), end());
}

/**
 * @param {HTMLElement} page
 * @param {Job} a of known size
 * @param {Job} b likewise
 * @param {Store<Comparison>} state
 * @returns {{life: Disposer, update: (a: Job, b: Job) => void}}
 */
function open(page, a, b, state) {
  const life = new Disposer();
  const left = new LiveFilm(a, frameOf(a, state.value.frame));
  const right = a.id === b.id ? left : new LiveFilm(b, frameOf(b, state.value.frame));
  for (const live of new Set([left, right])) life.add(() => live.dispose());
  const problems = h("div", { class: "stage-notice", role: "status" });
  let waysChanged = () => {};
  let hadPictures = "";
  const stage = pictureStage(left.film, life, {
    wiped: (wipe) => state.update((now) => ({ ...now, wipe })),
    changed: () => {
      const pictures = JSON.stringify([0, 1].map((which) => stage?.side(/** @type {0 | 1} */ (which))?.state.value ?? null));
      if (pictures !== hadPictures) waysChanged();
      hadPictures = pictures;
      const errors = [0, 1].map((which) => stage?.side(/** @type {0 | 1} */ (which))?.state.value.error);
      fill(
        problems,
        errors.filter(Boolean).map((error) => h("p", { class: "notice error" }, icon("warning"), messageOf(error))),
      );
    },
  });
  stage.element.append(problems);
  let latest = { a, b };
  const arrange = () => {
    const now = state.value;
    if (now.a !== a.id || now.b !== b.id) return; // others are being opened
    const [nameA, nameB] = sideNames({ job: latest.a, channel: now.left }, { job: latest.b, channel: now.right });
    stage.view?.setLook(now);
    stage.arrange({
      left: { live: left, channel: now.left, name: nameA },
      right: { live: right, channel: now.right, name: nameB },
      wipe: now.wipe,
    });
  };
  life.add(state.subscribe(arrange));
  const normalise = () => {
    const exposure = left.film.normalisingExposure();
    if (exposure != null) state.update((now) => ({ ...now, exposure: clampExposure(exposure) }));
  };
  const ways = compareWays({ stage, state, films: [left, right], life });
  waysChanged = ways.changed;
  const swap = () =>
    state.update((now) => ({ ...now, a: now.b, b: now.a, left: now.right, right: now.left, wipe: 1 - now.wipe }));
  life.add(addShortcuts(stageKeys({ view: stage.view, display: state, normalise })));
  life.add(addShortcuts(ways.keys));
  life.add(addShortcuts([{ keys: "X", does: t("Swap left and right"), run: swap }]));

  const frames = compareFrames([left, right], () => [latest.a, latest.b], state, life);
  const progress = [progressOf("A", a), progressOf("B", b)];
  const table = h("div", { class: "differences" });
  fill(
    page,
    h(
      "header",
      { class: "job-head" },
      h(
        "a",
        {
          ...{ class: "icon-button", href: linkTo("jobs", a.id), "aria-label": t("Back to the picture") },
          onclick: (/** @type {Event} */ event) => followWithFrame(event, isShot(a) ? left.frame : null),
        },
        icon("back"),
      ),
      h("h1", { class: "visually-hidden" }, t("Comparison of {a} and {b}", { a: a.name, b: b.name })),
      sideChoice("A", state, "a", "left", life),
      h(
        "button",
        { class: "icon-button", type: "button", "aria-label": t("Swap left and right"), title: t("Swap (X)"), onclick: swap },
        icon("swap"),
      ),
      sideChoice("B", state, "b", "right", life),
    ),
    stage.element,
    stage.statusBar,
    h(
      "aside",
      { class: "side", "aria-label": t("Comparison") },
      h(
        "section",
        { class: "side-section stack", "aria-label": t("Progress") },
        progress.map(({ element }) => element),
      ),
      ways.element,
      frames.element,
      h("section", { class: "side-section", "aria-label": t("Display") }, lookFields(state, normalise)),
      h(
        "section",
        { class: "side-section stack tight", "aria-label": t("Differences") },
        h("h2", null, t("Differences")),
        table,
      ),
    ),
  );
  let shownRows = "";
  return {
    life,
    update(nextA, nextB) {
      latest = { a: nextA, b: nextB };
      setTitle(t("{name}: A and B", { name: nextA.name }));
      progress[0]?.update(nextA);
      progress[1]?.update(nextB);
      frames.update();
      const rows = differences(nextA, nextB);
      const key = JSON.stringify(rows);
      if (key === shownRows) return;
      shownRows = key;
      fill(
        table,
        rows.length ? differenceTable(rows) : h("p", { class: "quiet" }, t("None: both have the same settings.")),
      );
      arrange(); // the sides are called by their differences
    },
  };
}

/** @param {unknown} error */
const messageOf = (error) => (error instanceof Error ? error.message : String(error));
