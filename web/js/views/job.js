/** The render view: the picture as it grows, and all that can be done with it. */

import { getJob } from "../api.js";
import { AovImage } from "../aov-image.js";
import { CHANNELS, EXPOSURE_STEP, clampExposure, displayFromUrl, displayPanel } from "../display-panel.js";
import { fill, h, setText } from "../dom.js";
import { jobs, putJob, setLink, workers } from "../farm.js";
import { field } from "../fields.js";
import { CannotShow } from "../film-canvas.js";
import { FilmView } from "../film-view.js";
import { emptyState, noWorkerNotice } from "../hints.js";
import { icon } from "../icons.js";
import { actionsPanel, moreSamples, pauseOrResume, progressPanel, savePanel } from "../job-panel.js";
import { Live } from "../live.js";
import { PixelReadout } from "../pixel-readout.js";
import { go, linkTo, setTitle } from "../router.js";
import { addShortcuts } from "../shortcuts.js";
import { progressBar, stateChip } from "../state-chip.js";
import { Disposer } from "../store.js";
import { outlinesOf } from "../tile-outlines.js";
import { announce, showError } from "../tray.js";
import { rememberPlace } from "../view-place.js";
import { removeJob } from "./job-row.js";

/** @typedef {import("../types.js").Job} Job */

/**
 * @param {string} id
 * @returns {{element: HTMLElement, dispose: () => void}}
 */
export function jobView(id) {
  setTitle("Picture");
  const life = new Disposer();
  const element = h("div", { class: "job-page" });
  /** @type {((job: Job) => void) | null} */
  let update = null;
  let asked = false;
  life.add(
    jobs.subscribe((all) => {
      const job = all?.find((candidate) => candidate.id === id);
      if (job && !(job.width && job.height)) {
        fill(element, h("div", { class: "page" }, emptyState("clock", job.name, h("p", null, job.error ?? job.message ?? "Waits for its scene"))));
      } else if (job) {
        update ??= open(element, job, life);
        update(job);
      } else if (all && !asked) {
        asked = true;
        getJob(id).then(putJob, (error) => fill(element, h("div", { class: "page" }, emptyState("image", "This picture is not here", h("p", null, error.message), h("a", { href: linkTo("jobs") }, "To the jobs")))));
      }
    }),
  );
  return { element, dispose: () => life.dispose() };
}

/**
 * @param {HTMLElement} page
 * @param {Job} job
 * @param {Disposer} life
 * @returns {(job: Job) => void}
 */
function open(page, job, life) {
  let latest = job;
  const firstFrame = job.frames[0]?.number ?? 0;
  const lastFrame = job.frames.at(-1)?.number ?? 0;
  const width = job.width ?? 1;
  const height = job.height ?? 1;
  let frame = firstFrame;
  const display = displayFromUrl();
  const actions = actionsPanel();
  const progress = progressPanel();
  const chip = stateChip(job.state);
  const line = progressBar("Progress");
  line.element.setAttribute("aria-hidden", "true"); // the panel's bar says the same
  const notice = h("div", { class: "stage-notice" });

  // The picture
  const zoom = h("span", { class: "mono" });
  /** @type {FilmView | null} */
  let view = null;
  /** @type {PixelReadout | null} */
  let readout = null;
  let remember = () => {};
  /** @type {Element} */
  let stage;
  try {
    const shown = new FilmView(width, height, {
      cursor: (at) => readout?.point(at),
      moved: () => {
        setText(zoom, zoomLabel(shown?.viewport.scale ?? 1));
        remember();
      },
    });
    view = shown;
    stage = shown.element;
    readout = new PixelReadout(job.id, shown.film);
    life.add(() => (readout?.dispose(), shown.dispose()));
    life.add(display.subscribe((look) => shown.setLook(look)));
    remember = rememberPlace(shown.viewport);
  } catch (error) {
    if (!(error instanceof CannotShow)) throw error;
    stage = h("div", { class: "stage" }, emptyState("image", "The live picture cannot be shown here", h("p", null, error.message)));
  }

  const channelTag = h("div", { class: "channel-tag", role: "status", hidden: true });
  const stageBox = h("div", { class: "stage-box" }, stage, channelTag, notice);
  stageBox.style.setProperty("--aspect", `${width} / ${height}`);

  const aov = new AovImage(job.id, {
    show: (image) => view?.setOverlay(image),
    waiting: (yes) => {
      const label = CHANNELS.find(({ name }) => name === display.value.channel)?.label ?? "";
      setText(channelTag, yes ? `${label} …` : label);
    },
    failed: (error) => showError("The channel could not be shown", error),
  });
  life.add(() => aov.dispose());
  const live = followLive();

  function followLive() {
    return new Live(job.id, frame, {
      tile(tile) {
        if (tile.frame !== (frame & 0xffff)) return;
        view?.putTile(tile);
        aov.stale = true;
        const at = readout?.at;
        if (at && at.x >= tile.x && at.y >= tile.y && at.x < tile.x + tile.w && at.y < tile.y + tile.h) readout?.refresh();
      },
      message(message) {
        if (message.type === "state") putJob(message.job);
      },
      link: (up) => setLink("live", up),
      refused: (sentence) => showError("The live picture ended", sentence, { action: { label: "Reload the page", run: () => location.reload() } }),
    });
  }
  life.add(() => (live.close(), setLink("live", true)));

  const outline = () => {
    const on = display.value.outlines && latest.state === "running";
    view?.setOutlines(on ? outlinesOf(workers.value ?? [], job.id, frame) : []);
  };
  life.add(workers.subscribe((all) => (outline(), fill(notice, all?.length === 0 && latest.state !== "finished" && noWorkerNotice()))));
  life.add(display.subscribe(({ channel }) => (outline(), (channelTag.hidden = channel === ""), readout?.choose(channel), aov.choose(channel, frame))));
  life.every(1000, progress.tick);

  const normalise = () => {
    const exposure = view?.film.normalisingExposure();
    if (exposure != null) display.update((d) => ({ ...d, exposure: clampExposure(exposure) }));
  };
  /** @param {number} by */
  const expose = (by) => {
    display.update((d) => ({ ...d, exposure: clampExposure(d.exposure + by) }));
    announce(`Exposure ${display.value.exposure} stops`);
  };
  life.add(
    addShortcuts([
      { keys: "E", does: "Half a stop brighter", run: () => expose(EXPOSURE_STEP) },
      { keys: "Shift+E", does: "Half a stop darker", run: () => expose(-EXPOSURE_STEP) },
      { keys: "R", does: "Reset the exposure", run: () => display.update((d) => ({ ...d, exposure: 0 })) },
      { keys: "N", does: "Normalise: the brightest below white", run: normalise },
      { keys: "F", does: "Fit the picture", run: () => view?.fit() },
      { keys: "1", does: "One picture pixel a screen pixel", run: () => view?.actualSize() },
      { keys: "+", does: "Zoom in", run: () => view?.zoom(1) },
      { keys: "-", does: "Zoom out", run: () => view?.zoom(-1) },
      { keys: "T", does: "Outline the tiles being rendered", run: () => display.update((d) => ({ ...d, outlines: !d.outlines })) },
      { keys: "Space", does: "Pause or resume", run: () => pauseOrResume(latest) },
      { keys: "M", does: "More samples", run: () => moreSamples(latest) },
      ...[["ArrowLeft", -1, 0], ["ArrowRight", 1, 0], ["ArrowUp", 0, -1], ["ArrowDown", 0, 1]].flatMap(([key, dx, dy]) =>
        [1, 10].map((by) => ({
          keys: `${by > 1 ? "Shift+" : ""}${key}`,
          does: "Read pixels by keys; with Shift ten at a time",
          shown: key === "ArrowLeft" && by === 1 ? "Arrows" : null,
          run: () => view?.moveCursor(Number(dx) * by, Number(dy) * by),
        })),
      ),
    ]),
  );

  fill(
    page,
    h(
      "header",
      { class: "job-head" },
      h("a", { class: "icon-button", href: linkTo("scenes", job.scene), "aria-label": "Back to the scene" }, icon("back")),
      h("h1", { title: job.name }, job.name),
      chip.element,
      h("span", { class: "grow" }),
      actions.element,
      h(
        "button",
        { class: "icon-button danger", type: "button", "aria-label": "Delete this picture", title: "Delete this picture", onclick: () => (removeJob(latest), go("jobs")) },
        icon("trash"),
      ),
    ),
    h("div", { class: "job-line" }, line.element),
    stageBox,
    h(
      "footer",
      { class: "status-bar" },
      readout?.element,
      h("span", { class: "grow" }),
      h("span", { class: "quiet number size" }, `${width}×${height}`),
      h(
        "span",
        { class: "zoom-controls" },
        h("button", { class: "icon-button", type: "button", "aria-label": "Zoom out", title: "Zoom out (−)", onclick: () => view?.zoom(-1) }, "−"),
        h("button", { class: "icon-button zoom-button", type: "button", title: "Zoom; press for one to one (1)", onclick: () => view?.actualSize() }, zoom),
        h("button", { class: "icon-button", type: "button", "aria-label": "Zoom in", title: "Zoom in (+)", onclick: () => view?.zoom(1) }, "+"),
        h("button", { class: "icon-button", type: "button", "aria-label": "Fit the picture", title: "Fit (F)", onclick: () => view?.fit() }, icon("fit")),
      ),
    ),
    h(
      "aside",
      { class: "side", "aria-label": "Picture" },
      progress.element,
      lastFrame > firstFrame && frameSlider(),
      displayPanel(display, { normalise }),
      savePanel(job, () => frame, display),
      details(job),
    ),
  );

  function frameSlider() {
    const number = h("output", { class: "mono" }, frame);
    const slider = h("input", { type: "range", min: firstFrame, max: lastFrame, step: 1, value: String(frame) });
    slider.addEventListener("input", () => {
      frame = slider.valueAsNumber;
      setText(number, frame);
      view?.clear();
      if (readout) readout.frame = frame;
      live.watch(frame);
      aov.choose(display.value.channel, frame);
      outline();
    });
    const whole = field("Frame", slider);
    whole.prepend(h("div", { class: "row" }, whole.firstElementChild, number));
    return h("section", { class: "side-section", "aria-label": "Frame" }, whole);
  }

  return (next) => {
    if (next.state !== latest.state) announce(`${next.name}: ${next.state}`);
    latest = next;
    setTitle(`${next.state === "running" ? `${Math.floor(next.progress * 100)} % ` : ""}${next.name}`);
    chip.update(next.state);
    actions.update(next);
    progress.update(next);
    line.update(next.progress, next.state);
    outline();
  };
}

/** @param {number} scale */
function zoomLabel(scale) {
  const percent = scale * 100;
  return `${percent >= 10 ? Math.round(percent) : percent.toFixed(1)} %`;
}

/** @param {Job} job */
function details(job) {
  /** @type {[string, import("../dom.js").Child][]} */
  const rows = [
    ["Scene", h("a", { href: linkTo("scenes", job.scene) }, job.name)],
    ["Size", `${job.width}×${job.height}`],
    ["Field of view", job.settings && `${Number(job.settings.view.fov.toFixed(1))}°`],
    ["Max depth", job.settings?.max_depth],
    ["Seed", job.settings?.seed],
    ["Job", h("code", null, job.id)],
  ];
  return h(
    "section",
    { class: "side-section", "aria-label": "Details" },
    h("h2", null, "Details"),
    h("dl", { class: "facts number" }, rows.filter(([, value]) => value != null).map(([name, value]) => h("div", null, h("dt", null, name), h("dd", null, value)))),
  );
}
