/** The growing picture of a job, its AOVs, and its denoised copy instead of it or beside it. */

import { DENOISED, DENOISED_MIX, MIX } from "./channels.js";
import { imageUrl, thumbnailFormat } from "../news/api.js";
import { jobRowOf, shownUrl } from "../news/shown-images.js";
import { workers } from "../news/farm.js";
import { LiveFilm } from "./live-film.js";
import { CARD_WIDTH, jobLook, lookOfJob, perPixel } from "./job-look.js";
import { isMixed } from "./light-mix.js";
import { pictureStage } from "./picture-stage.js";
import { outlinesOf } from "./tile-outlines.js";
import { firstFrame } from "../base/shot-words.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/store.js").Store<import("../job/display-panel.js").Display>} DisplayStore */
/** @typedef {import("./picture-side.js").SideState} SideState */

/**
 * @typedef {object} LivePicture
 * @property {HTMLElement} element
 * @property {HTMLElement} statusBar
 * @property {HTMLElement} tools room in it
 * @property {import("./film-view.js").FilmView | null} view null where this browser cannot show a film
 * @property {LiveFilm} live
 * @property {() => import("./picture-side.js").PictureSide | null} side the one that is not denoised
 * @property {import("./film.js").Film} film
 * @property {() => import("./film.js").Film} shown the denoised film if the stage shows that, else the film
 * @property {(job: Job) => void} update
 * @property {(listener: (outlines: import("./pixel-overlay.js").Outline[]) => void) => void} onHands calls the listener with the tiles that workers are rendering
 * @property {() => boolean} awaitsLast whether the job's last denoised picture is still to come
 * @property {() => void} renew fetches the shown pictures again if they are older than the film
 */

/**
 * @param {Job} job of known size
 * @param {DisplayStore} display
 * @param {import("../base/store.js").Disposer} life
 * @param {(state: {left: SideState | null, right: SideState | null}) => void} changed called when a side's state of fetching changes
 * @param {number} [frame] of a shot
 * @returns {LivePicture}
 */
export function livePicture(job, display, life, changed, frame) {
  // The film is many times as large as the poster, and the service makes both: first what can be seen first.
  let isPosterHere = () => {};
  const live = new LiveFilm(job, frame, new Promise((resolve) => (isPosterHere = () => resolve(null))));
  life.add(() => live.dispose());
  const stage = pictureStage(live.film, life, {
    wiped: (wipe) => display.update((look) => ({ ...look, wipe })),
    changed: () => changed({ left: stateOf(0), right: stateOf(1) }),
  });
  const stateOf = (/** @type {0 | 1} */ which) => stage.side(which)?.state.value ?? null;
  const renew = () => {
    for (const which of /** @type {const} */ ([0, 1])) {
      const state = stateOf(which);
      if (state && (state.stale || state.error) && !state.waiting) void stage.side(which)?.fetch();
    }
  };

  const poster = posterOf(job, live.frame, display.value);
  const isClean = job.denoise || display.value.denoise !== "off"; // without a preview the noisy one stays
  stage.view?.setPoster(live.clean || (poster?.near ?? null), isClean && !live.clean && !live.look && !isSmall(job) ? poster?.clean : "", live.clean ? "" : poster?.nearest);
  if (stage.view) stage.view.origin = live.place;
  queueMicrotask(() => stage.element.isConnected && stage.view?.canvas.resize()); // in its place from the first frame
  void Promise.race([stage.view?.poster?.loaded, new Promise((resolve) => setTimeout(resolve, POSTER_MS))]).then(isPosterHere);

  let latest = job;
  /** @type {(outlines: import("./pixel-overlay.js").Outline[]) => void} */
  let inHand = () => {};
  const outline = () => {
    const outlines = latest.state === "running" ? outlinesOf(workers.value ?? [], live) : [];
    stage.view?.setOutlines(display.value.outlines ? outlines : []);
    inHand(outlines);
  };
  life.add(workers.subscribe(outline));
  life.add(live.onTurn(outline));
  life.add(
    display.subscribe((look) => {
      const mixed = look.channel === "" && isMixed(look.mix);
      const denoised = look.denoise !== "off" && look.channel === "";
      const isMixSeen = mixed && look.denoise !== "on"; // its planes are fetched
      stage.view?.setLook(look);
      stage.view?.poster?.element.classList.toggle("smooth", denoised && !live.clean && perPixel(job) < NOISY_SPP);
      stage.arrange({
        left: isMixSeen ? { live, channel: MIX, mix: look.mix } : { live, channel: look.channel, name: look.channel === "" ? t("Raw") : undefined },
        right: denoised ? { live, channel: mixed ? DENOISED_MIX : DENOISED, mix: look.mix } : null,
        wipe: look.denoise === "wipe" ? look.wipe : null,
      });
      outline();
    }),
  );
  return {
    element: stage.element,
    statusBar: stage.statusBar,
    tools: stage.tools,
    view: stage.view,
    live,
    side: () => stage.side(0),
    film: live.film,
    shown: () => stage.side(1)?.film ?? live.film,
    update(next) {
      latest = next;
      outline();
    },
    awaitsLast: () => stage.side(1)?.awaitsLast() === true,
    renew,
    onHands(listener) {
      inHand = listener;
      outline();
    },
  };
}

/** Time, in milliseconds, that the film waits for the poster at most. */
const POSTER_MS = 1000;
/** Least width, in pixels, of the picture until the film is here: about that of the stage. */
const POSTER_WIDTH = 1280;
/** Samples per pixel below which the noise of a picture is worse than a blur, until it is denoised. */
const NOISY_SPP = 16;

/** Whether the picture in a list is as large as the job's. @param {Job} job */
const isSmall = ({ width }) => (width ?? 0) <= CARD_WIDTH;

/**
 * Returns the URLs of a job's picture until its film is here: the small copy that a list has shown, one of about the stage's size, and
 * its latest denoised preview in full resolution, if one is stored.
 *
 * @param {Job} job
 * @param {number} frame
 * @param {{exposure: number, curve: string, channel: string}} look
 */
function posterOf(job, frame, { exposure, curve, channel }) {
  const { id, samples } = job;
  if (!samples || channel) return null;
  const usual = jobLook(job);
  const isUsual = exposure === usual.exposure && curve === usual.curve;
  /** @type {Record<string, string | number>} */
  const look = isUsual ? { visible: "true", ...lookOfJob(job), v: samples } : { v: samples, exposure, tonemap: curve };
  const url = (/** @type {Record<string, string | number>} */ query) => imageUrl({ job: id, frame }, thumbnailFormat(job), { ...query, ...look });
  const nearest = isUsual && frame === firstFrame(job) ? shownUrl(jobRowOf(id)) : "";
  const isWhole = nearest !== "" && isSmall(job);
  const isStored = frame === firstFrame(job) && job.frames?.[0]?.denoised === true;
  return { nearest, near: isWhole ? nearest : url({ width: POSTER_WIDTH }), clean: isStored ? url({ denoise: "true", preview: "true", wait: "false" }) : "" };
}
