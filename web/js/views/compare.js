/** The comparison view: two jobs, snapshots, planes, or uploaded pictures. */

import { jobLook } from "../film/job-look.js";
import { getJob } from "../news/api.js";
import { differenceTable, progressOf, sideChoice } from "../compare/compare-panel.js";
import { clampExposure, lookFields, lookFromUrl, lookParams, wipeFrom } from "../job/display-panel.js";
import { fill, h, setText } from "../base/dom.js";
import { stops } from "../base/format.js";
import { adoptJob, jobs, workers } from "../news/farm.js";
import { emptyState } from "../shell/hints.js";
import { icon } from "../base/icons.js";
import { isOtherPicture } from "../compare/job-differences.js";
import { differencesOf, filmOf, namesOf, pictureOfJob, pictureOfReference, pictureUrl, referenceId } from "../compare/pictures.js";
import { referencePanel } from "../compare/reference-panel.js";
import { findReference, loadReferences, references } from "../news/references.js";
import { snapshotsOf } from "../compare/snapshots.js";
import { compareWays, mapOf, wayFrom } from "../compare/ways.js";
import { DENOISED } from "../film/channels.js";
import { StillFilm } from "../film/still-film.js";
import { canDenoise } from "../job/denoise-fields.js";
import { pictureTools } from "../job/picture-tools.js";
import { pictureStage } from "../film/picture-stage.js";
import { stageKeys } from "../job/render-keys.js";
import { followWithFrame, here, linkTo, setParams, setTitle } from "../shell/router.js";
import { compareFrames } from "../shot/compare-frames.js";
import { isShot } from "../base/shot-words.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { Disposer, Store } from "../base/store.js";
import { saidOf } from "../base/said.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../compare/pictures.js").Picture} Picture */
/** @typedef {import("../film/picture-side.js").FilmSource} FilmSource */

/**
 * @typedef {object} Comparison
 * @property {string} a as an address has it: see compare/pictures.js
 * @property {string} b
 * @property {string} left a channel of it
 * @property {string} right
 * @property {number | null} atA what it looked like at so many samples a pixel; null: as it is now
 * @property {number | null} atB
 * @property {number | null} frame of a side that is a shot; null: its first
 * @property {number} wipe
 * @property {import("../compare/ways.js").Way} way
 * @property {number} exposure of A, in stops
 * @property {boolean} isCommon whether B has A's exposure; else both differ as in their jobs
 * @property {string} curve
 */

/**
 * @param {string} a a picture, as an address has it
 * @param {string} [b] another, or the same; left out: the latest one that it can be compared with
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
    ...{ atA: frameFrom(params.get("ta")), atB: frameFrom(params.get("tb")) },
    frame: frameFrom(params.get("frame")),
    wipe: wipeFrom(params.get("wipe")),
    way: wayFrom(params.get("way")),
    isCommon: params.get("same") === "1",
    ...lookFromUrl(params, lookOf(a)),
  });
  /** Whether the default look, that of the first picture, is known. */
  let hasLook = false;
  /**
   * The open comparison, closed before the next opens.
   * @type {{key: string, life: Disposer, update: (a: Picture, b: Picture) => void} | null}
   */
  let opened = null;
  life.add(() => opened?.life.dispose());

  /** @type {Set<string>} */
  const asked = new Set();
  const show = () => {
    const all = jobs.value;
    if (!all) return;
    if (!state.value.b) {
      if (!workers.value) return; // the default partner depends on what they can do
      const first = all.find(({ id }) => id === state.value.a);
      if (first) state.update((now) => ({ ...now, ...partnerOf(first, all, canDenoise(workers.value)) }));
    }
    const ids = [state.value.a, state.value.b].filter(Boolean);
    for (const id of ids) {
      if (asked.has(id) || referenceId(id) !== null || all.some((job) => job.id === id)) continue;
      asked.add(id);
      getJob(id).then(adoptJob, (error) => instead(t("This picture is not here"), error.status === 404 ? t("It was deleted, or its address is incomplete.") : error.message));
    }
    const waits = all.find(({ id, width }) => ids.includes(id) && !width);
    if (waits) {
      instead(waits.name, saidOf(waits, waits.error ? "error" : "message") || t("Waiting for its scene."));
      return;
    }
    const lost = ids.map(referenceId).find((id) => id !== null && references.value && !references.value.some((each) => each.id === id));
    if (lost && references.hasMore && !asked.has(lost)) {
      asked.add(lost);
      findReference(lost).catch(show);
      return;
    }
    if (lost) {
      instead(t("This picture is not here"), t("The reference picture was removed. Upload it again to compare with it."));
      return;
    }
    const [first, second] = ids.map((id) => pictureOf(id, all));
    if (!first || !second) return;
    if (!hasLook) {
      hasLook = true;
      state.update((now) => ({ ...now, ...lookFromUrl(params, lookOf(a)) }));
    }
    const key = `${first.id} ${second.id}`;
    if (opened?.key !== key) {
      opened?.life.dispose();
      opened = { key, ...open(element, first, second, state) };
    }
    opened.update(first, second);
  };
  life.add(jobs.subscribe(show));
  life.add(references.subscribe(show));
  life.add(workers.subscribe(() => state.value.b || show()));
  if (!references.value) loadReferences().catch((error) => instead(t("The reference pictures could not be loaded"), error.message));
  life.add(
    state.subscribe(({ a, b }) => {
      if (b && opened && opened.key !== `${a} ${b}`) show();
    }),
  );
  life.add(rememberComparison(state));
  return { element, dispose: () => life.dispose() };
}

/** @param {string} id as the address has it @returns {import("../job/display-panel.js").Look} its default, once it is known */
const lookOf = (id) => jobLook(jobs.value?.find((job) => job.id === id));

/**
 * Returns how many stops the exposure of B is above that of A. An uploaded picture has that of the other.
 *
 * @param {Pick<Comparison, "a" | "b" | "isCommon">} comparison
 */
const stopsApart = ({ a, b, isCommon }) => (isCommon || [a, b].some((id) => referenceId(id) !== null) ? 0 : lookOf(b).exposure - lookOf(a).exposure);

/** @param {string} id as the address has it @param {Job[]} all @returns {Picture | null} null: not known yet */
function pictureOf(id, all) {
  const reference = references.value?.find((each) => each.id === referenceId(id));
  if (reference) return pictureOfReference(reference);
  const job = all.find((each) => each.id === id);
  return job ? pictureOfJob(job) : null;
}

/**
 * Returns the default partner of a picture: the previous one of its scene that looks different, else the next; else its own denoised
 * picture, else its albedo. Two pictures that were asked for denoised are shown denoised.
 *
 * @param {Job} job
 * @param {Job[]} all newest first
 * @param {boolean} denoises whether a connected worker can denoise
 * @returns {Partial<Comparison>}
 */
function partnerOf(job, all, denoises) {
  const others = all.filter((each) => each.scene === job.scene && each.id !== job.id && each.width && each.samples > 0 && isOtherPicture(job, each));
  const other = others.find(({ created }) => created <= job.created) ?? others.at(-1);
  if (!other) return { b: job.id, right: denoises ? DENOISED : "albedo" };
  return { b: other.id, ...(denoises && job.denoise && other.denoise && { left: DENOISED, right: DENOISED }) };
}

/** @param {string | null} text as an address has it */
const frameFrom = (text) => (text && Number.isFinite(Number(text)) ? Number(text) : null);

/** @param {Store<Comparison>} state @returns {() => void} ends it */
function rememberComparison(state) {
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  const end = state.subscribe(({ a, b, left, right, atA, atB, frame, wipe, way, exposure, isCommon, curve }) => {
    clearTimeout(timer);
    if (!b) return;
    timer = setTimeout(() => {
      setParams(
        {
          a: left || null,
          b: right || null,
          ta: atA === null ? null : String(atA),
          tb: atB === null ? null : String(atB),
          frame: frame === null ? null : String(frame),
          wipe: wipe === 0.5 ? null : wipe.toFixed(3),
          way: way === "wipe" ? null : way,
          same: isCommon ? "1" : null,
          ...lookParams({ exposure, curve }, lookOf(a)),
        },
        ["compare", a, b],
      );
    }, 300);
  });
  return () => (clearTimeout(timer), end());
}

/**
 * @param {HTMLElement} page
 * @param {Picture} a
 * @param {Picture} b
 * @param {Store<Comparison>} state
 * @returns {{life: Disposer, update: (a: Picture, b: Picture) => void}}
 */
function open(page, a, b, state) {
  const life = new Disposer();
  const differ = a.width !== b.width || a.height !== b.height;
  /** Uploaded pictures are only shown at their own size. */
  const isRefused = differ && Boolean(a.reference || b.reference);
  /** The shown films, by picture and snapshot. @type {Map<string, {live: FilmSource, end: () => void}>} */
  const films = new Map();
  life.add(() => films.forEach(({ end }) => end()));
  const problems = h("div", { class: "stage-notice", role: "status" });
  let waysChanged = () => {};
  /** @type {unknown[]} */
  let notThere = [];
  const tell = () => {
    const errors = [0, 1].map((which) => stage?.side(/** @type {0 | 1} */ (which))?.state.value.error).concat(notThere);
    const sizes = { a: `${a.width}×${a.height}`, b: `${b.width}×${b.height}` };
    fill(
      problems,
      isRefused && h("p", { class: "notice warning" }, icon("warning"), t("A is {a}, B is {b}: choose two of the same size. Neither is stretched; A is shown alone.", sizes)),
      ...errors.filter(Boolean).map((error) => h("p", { class: "notice error" }, icon("warning"), messageOf(error))),
    );
  };
  let hadPictures = "";
  const stage = pictureStage(a, life, {
    wiped: (wipe) => state.update((now) => ({ ...now, wipe })),
    changed: () => {
      const pictures = JSON.stringify([0, 1].map((which) => stage?.side(/** @type {0 | 1} */ (which))?.state.value ?? null));
      if (pictures !== hadPictures) waysChanged();
      hadPictures = pictures;
      tell();
    },
  });
  stage.element.append(problems);
  let latest = { a, b };
  const arrange = () => {
    const now = state.value;
    if (now.a !== a.id || now.b !== b.id) return; // another comparison is being opened
    const [sideA, sideB] = sides();
    const [nameA, nameB] = namesOf(sideA, sideB);
    if (stage.view) stage.view.layers[1].moreExposure = stopsApart(now);
    stage.view?.setLook(now);
    notThere = [];
    const shown = [filmFor(sideA), filmFor(sideB)];
    const [left, right] = [
      { live: /** @type {FilmSource} */ (shown[0]), channel: sideA.channel, name: nameA },
      { live: /** @type {FilmSource} */ (shown[1]), channel: sideB.channel, name: nameB },
    ];
    stage.arrange({ left, right: isRefused ? null : right, wipe: isRefused ? null : mapOf(now.way) ? 1 : now.wipe }); // A alone until its map is here
    if (isRefused) stage.view?.setWipe(1);
    for (const [key, { live, end }] of films)
      if (!shown.includes(live)) {
        films.delete(key);
        end();
      }
    showDifferences();
  };
  /**
   * Planes exist only for a job's current picture.
   * @returns {[import("../compare/pictures.js").Side, import("../compare/pictures.js").Side]}
   */
  const sides = () => {
    const { left, right, atA, atB } = state.value;
    const side = (/** @type {Picture} */ picture, /** @type {string} */ channel, /** @type {number | null} */ at) => {
      const moment = picture.job ? at : null;
      return { picture, channel: picture.reference || moment !== null ? "" : channel, at: moment };
    };
    return [side(latest.a, left, atA), side(latest.b, right, atB)];
  };
  const filmFor = (/** @type {import("../compare/pictures.js").Side} */ { picture, at }) => {
    const key = `${picture.id} ${at}`;
    const known = films.get(key);
    if (known) return known.live;
    const live = filmOf(picture, at, state.value.frame);
    const deaf = ways.listen(live);
    films.set(key, { live, end: () => (deaf(), live.dispose()) });
    if (live instanceof StillFilm)
      live.ready.catch((error) => {
        if (live.fetching.signal.aborted) return;
        notThere = [...notThere, error];
        tell();
      });
    return live;
  };
  const shownFilms = () => sides().map(filmFor);
  const normalise = () => {
    const exposure = shownFilms()[0]?.film.normalisingExposure();
    if (exposure != null) state.update((now) => ({ ...now, exposure: clampExposure(exposure) }));
  };
  const ways = compareWays({ stage, state, differInSize: () => differ, life });
  waysChanged = ways.changed;
  const table = h("div", { class: "differences" });
  let shownRows = "";
  const showDifferences = () => {
    const rows = differencesOf(...sides());
    const key = JSON.stringify(rows);
    if (key === shownRows) return;
    shownRows = key;
    fill(table, rows.length ? differenceTable(rows) : h("p", { class: "quiet" }, t("None: both have the same settings.")));
  };
  life.add(state.subscribe(arrange));
  const swap = () =>
    state.update((now) => ({
      ...{ ...now, exposure: clampExposure(now.exposure + stopsApart(now)), a: now.b, b: now.a, left: now.right, right: now.left, atA: now.atB, atB: now.atA },
      wipe: 1 - now.wipe,
    }));
  life.add(addShortcuts(stageKeys({ view: stage.view, display: state, normalise }), "view"));
  life.add(addShortcuts(ways.keys, "view"));
  life.add(addShortcuts([{ keys: "X", does: t("Swap left and right"), run: swap }], "view"));

  const frames = compareFrames(shownFilms, () => [latest.a.job, latest.b.job], state, life);
  const progress = /** @type {const} */ (["A", "B"]).map((letter, i) => {
    const { job } = i ? b : a;
    return job && progressOf(letter, job);
  });
  const moments = snapshotsOf(() => [latest.a.job, latest.b.job], life);
  const home = a.job ?? b.job;
  const tools = pictureTools(stage.element, stage.view, () => {
    const [{ picture, channel, at }] = sides();
    return pictureUrl(picture, channel, at, state.value);
  });
  stage.tools.append(tools.element);
  life.add(addShortcuts(tools.keys, "picture"));
  fill(
    page,
    h(
      "header",
      { class: "job-head" },
      h(
        "a",
        {
          ...{ class: "icon-button", href: home ? linkTo("jobs", home.id) : linkTo("jobs"), "aria-label": t("Back to the picture") },
          onclick: (/** @type {Event} */ event) => followWithFrame(event, home && isShot(home) ? (shownFilms()[a.job ? 0 : 1]?.frame ?? null) : null),
        },
        icon("back"),
      ),
      h("h1", { class: "visually-hidden" }, t("Comparison of {a} and {b}", { a: a.name, b: b.name })),
      sideChoice("A", state, { picture: "a", channel: "left", at: "atA" }, moments, life),
      h(
        "button",
        { class: "icon-button", type: "button", "aria-label": t("Swap left and right"), title: t("Swap (X)"), onclick: swap },
        icon("swap"),
      ),
      sideChoice("B", state, { picture: "b", channel: "right", at: "atB" }, moments, life),
    ),
    stage.element,
    stage.statusBar,
    h(
      "aside",
      { class: "side", "aria-label": t("Comparison") },
      h(
        "section",
        { class: "side-section stack", "aria-label": t("Progress") },
        progress.map((part) => part?.element),
      ),
      ways.element,
      frames.element,
      h("section", { class: "side-section", "aria-label": t("Display") }, lookFields(state, normalise, exposures(state, life))),
      h(
        "section",
        { class: "side-section stack tight", "aria-label": t("Differences") },
        h("h2", null, t("Differences")),
        table,
      ),
      referencePanel(state, life),
    ),
  );
  return {
    life,
    update(nextA, nextB) {
      latest = { a: nextA, b: nextB };
      setTitle(t("{name}: A and B", { name: nextA.name }));
      if (nextA.job) progress[0]?.update(nextA.job);
      if (nextB.job) progress[1]?.update(nextB.job);
      frames.update();
      moments.renew();
      const before = shownRows;
      showDifferences();
      if (shownRows !== before) arrange(); // the sides' names depend on their differences
    },
  };
}

/** The exposures of the two pictures where their jobs' differ, and the choice of one for both. @param {Store<Comparison>} state @param {Disposer} life */
function exposures(state, life) {
  const both = h("span", { class: "quiet small number" });
  const common = h("input", { type: "checkbox", onchange: () => state.update((now) => ({ ...now, isCommon: common.checked })) });
  const element = h("div", { class: "row spread exposures" }, h("label", { class: "check" }, common, t("Same exposure")), both);
  life.add(
    state.subscribe((now) => {
      element.hidden = !stopsApart({ ...now, isCommon: false });
      common.checked = now.isCommon;
      setText(both, t("A {a}, B {b} EV", { a: stops(now.exposure), b: stops(now.exposure + stopsApart(now)) }));
    }),
  );
  return element;
}

/** @param {unknown} error */
const messageOf = (error) => (error instanceof Error ? error.message : String(error));
