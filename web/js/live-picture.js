/** The picture of a job as it grows: the film's view, its live connection, the channel that is shown, the pixel's values. */

import { AovImage } from "./aov-image.js";
import { CHANNELS } from "./display-panel.js";
import { h, setText } from "./dom.js";
import { putJob, setLink, workers } from "./farm.js";
import { CannotShow } from "./film-canvas.js";
import { FilmView } from "./film-view.js";
import { emptyState } from "./hints.js";
import { Live } from "./live.js";
import { PixelReadout } from "./pixel-readout.js";
import { outlinesOf } from "./tile-outlines.js";
import { showError } from "./tray.js";
import { rememberPlace } from "./view-place.js";
import { zoomControls } from "./zoom-controls.js";

/** @typedef {import("./types.js").Job} Job */
/** @typedef {import("./store.js").Store<import("./display-panel.js").Display>} DisplayStore */

/**
 * @typedef {object} LivePicture
 * @property {HTMLElement} element
 * @property {HTMLElement} statusBar
 * @property {FilmView | null} view null where this browser cannot show a film
 * @property {(job: Job) => void} update
 */

/**
 * @param {Job} job of known size
 * @param {DisplayStore} display
 * @param {import("./store.js").Disposer} life
 * @returns {LivePicture}
 */
export function livePicture(job, display, life) {
  const width = job.width ?? 1;
  const height = job.height ?? 1;
  const zoom = zoomControls(() => view);
  let moved = () => {};
  const made = filmView(width, height, {
    cursor: (at) => readout?.point(at),
    moved: () => moved(),
  });
  const view = made instanceof FilmView ? made : null;
  const readout = view && new PixelReadout(job.id, view.film);
  if (view && readout) {
    const remember = rememberPlace(view.viewport);
    moved = () => {
      zoom.show(view.viewport.scale);
      remember();
    };
    life.add(() => (readout.dispose(), view.dispose()));
  }

  const tag = h("div", { class: "channel-tag", role: "status", hidden: true });
  const aov = new AovImage(job.id, {
    show: (image) => view?.setOverlay(image),
    waiting: (yes) => {
      const label = CHANNELS.find(({ name }) => name === display.value.channel)?.label ?? "";
      setText(tag, yes ? `${label} …` : label);
    },
    failed: (error) => showError("The channel could not be shown", error),
  });
  life.add(() => aov.dispose());

  const live = new Live(job.id, {
    tile(tile) {
      view?.putTile(tile);
      readout?.tileChanged(tile);
      aov.stale = true;
    },
    message: (message) => message.type === "state" && putJob(message.job),
    link: (up) => setLink("live", up),
    refused: (sentence) =>
      showError("The live picture ended", sentence, {
        action: { label: "Reload the page", run: () => location.reload() },
      }),
  });
  life.add(() => (live.close(), setLink("live", true)));

  let latest = job;
  const outline = () => {
    const on = display.value.outlines && latest.state === "running";
    view?.setOutlines(on ? outlinesOf(workers.value ?? [], job.id) : []);
  };
  life.add(workers.subscribe(outline));
  life.add(
    display.subscribe((look) => {
      tag.hidden = look.channel === "";
      view?.setLook(look);
      readout?.choose(look.channel);
      aov.choose(look.channel);
      outline();
    }),
  );

  const element = h("div", { class: "stage-box" }, made instanceof FilmView ? made.element : insteadOfFilm(made), tag);
  element.style.setProperty("--aspect", `${width} / ${height}`);
  const statusBar = h(
    "footer",
    { class: "status-bar" },
    readout?.element,
    h("span", { class: "grow" }),
    h("span", { class: "quiet number size" }, `${width}×${height}`),
    zoom.element,
  );
  return {
    element,
    statusBar,
    view,
    update(next) {
      latest = next;
      outline();
    },
  };
}

/**
 * @param {number} width
 * @param {number} height
 * @param {import("./film-view.js").FilmHandlers} handlers
 * @returns {FilmView | CannotShow}
 */
function filmView(width, height, handlers) {
  try {
    return new FilmView(width, height, handlers);
  } catch (error) {
    if (error instanceof CannotShow) return error;
    throw error;
  }
}

/** @param {CannotShow} refusal */
function insteadOfFilm({ message }) {
  return h(
    "div",
    { class: "stage" },
    emptyState("image", "The live picture cannot be shown here", h("p", null, message)),
  );
}
