/**
 * One side of the stage, left or right of the wipe: a channel of a job on a layer. Colour updates live; planes are fetched, and
 * refreshed while the job runs. A denoised picture is stale from the next sample on. While the job renders, it is a preview, which is
 * renewed as the samples grow; the last one is of all samples.
 */

import { fetchImage, fetchWords } from "../news/api.js";
import { AlphaPlane } from "./alpha-plane.js";
import { DENOISED, DENOISED_MIX, MIX, channelOfLight, lightGroupOf } from "./channels.js";
import { Film } from "./film.js";
import { gainsOf, mixWords } from "./light-mix.js";
import { PREVIEW_GROWTH, ROUGH_PREVIEW_GROWTH, ROUGH_PREVIEW_SAMPLES, UNRESTED_PREVIEW_GROWTH } from "../base/protocol.js";
import { Store } from "../base/store.js";

/**
 * The source of a side's pictures: a job's growing film, or another object with the same interface. `job` is "" if there
 * is no job. `isRendering`, `look`, `clean`, `worth`, `isAgain`, `hasPoster`, `isDenoisedStored` and `side` are those of a LiveFilm. `hasSamples` is false for a picture that no farm has rendered. `isTransparent` is true if it has an alpha plane.
 *
 * @typedef {Pick<import("./live-film.js").LiveFilm, "job" | "frame" | "film" | "finished" | "onTile" | "onFill" | "onTurn"> & {hasSamples?: boolean, isTransparent?: boolean, isRendering?: boolean, look?: Film | null, clean?: string, worth?: number, isAgain?: boolean, hasPoster?: boolean, isDenoisedStored?: boolean, side?: number}} FilmSource
 */

/** Minimum interval between refreshes of a stale picture. */
const EVERY_MS = 3000;
const SETTLE_MS = 300;
/** Interval at which a preview may become due. */
const PREVIEW_MS = 400;
/** Time after which a preview that could not be made or fetched is asked for again. */
const FAILED_MS = 10_000;
/** Samples per pixel that the picture with which the job began is worth if it is clear. */
const CLEAR = 16;
/** Samples per pixel from which a preview replaces a picture of the same camera and light: denoising fewer smears and frays. */
const LEAST_SPP = 4;
/** Time, in milliseconds, after which the first preview comes although the picture with which the job began is better: with LEAST_SPP, and with any samples. */
const [SOON_MS, AT_LAST_MS] = [1000, 8000];
/** Time, in milliseconds, after which the noise is shown if no denoised picture has come: in place of a picture of another camera or light, of a rough one, and of a clear one. */
const [STALE_MS, NOISE_AFTER_MS, NOISE_AT_LAST_MS] = [2000, 5000, 12_000];

/**
 * @typedef {object} SideState
 * @property {string} channel
 * @property {boolean} waiting for the service to make it
 * @property {boolean} stale the film has more samples than the shown picture
 * @property {boolean} [isPreview] the shown picture is a preview, and is renewed while the job renders, or replaced when it has ended
 * @property {number} [spp] samples per pixel of the shown preview
 * @property {boolean} [isLast] no more samples will come
 * @property {boolean} [isFinal] the last denoised picture is being fetched
 * @property {boolean} [isImproved] a denoised picture is shown while a better one is made
 * @property {[number, number] | null} [span] the values between which a heat map is drawn
 * @property {unknown} error why it could not be fetched
 */

/** @param {string} channel */
const isMix = (channel) => channel === MIX || channel === DENOISED_MIX;

/** Whether a channel is fetched as radiance, not as an image. @param {string} channel */
const hasWords = (channel) => channel === DENOISED || isMix(channel) || lightGroupOf(channel) !== null;

export class PictureSide {
  /**
   * @param {FilmSource} live
   * @param {import("./film-layer.js").FilmLayer} layer
   */
  constructor(live, layer) {
    this.live = live;
    this.layer = layer;
    this.state = new Store(/** @type {SideState} */ ({ channel: "", waiting: false, stale: false, error: null }));
    /** The denoised film, that of a light group or of a mix, if that channel is selected and loaded. @type {Film | null} */
    this.fetched = null;
    /** What the channels MIX and DENOISED_MIX show. @type {readonly import("./light-mix.js").Strip[]} */
    this.mix = [];
    /** The planes of the light groups, in the order of the mix, while the channel is a mix and they are loaded. @type {Uint32Array[] | null} */
    this.planes = null;
    /** Whether the planes are denoised. */
    this.hasCleanPlanes = false;
    this.mixing = 0;
    /** Number of samples in the shown picture; Infinity while none is loaded. */
    this.madeOf = Infinity;
    this.fetching = new AbortController();
    /** A played frame that replaces the live one. @type {Film | null} */
    this.played = null;
    /** Whether the shown picture is a preview of a job that was rendering. */
    this.isPreview = false;
    /** When the next preview may be asked for. */
    this.previewAt = 0;
    /** Samples of the film from which it is requested earlier, since the service then renews rough previews without a rest. */
    this.previewFrom = Infinity;
    /** When every tile first had samples. @type {number | undefined} */
    this.coveredAt = undefined;
    /** Samples per pixel of the noisy film that its tag states. */
    this.toldSpp = 0;
    this.timer = setInterval(() => this.isOld() && void this.fetch(), EVERY_MS);
    this.previewTimer = setInterval(() => this.lookAgain(), PREVIEW_MS);
    /** @type {ReturnType<typeof setTimeout> | undefined} */
    this.settling = undefined;
    this.unturn = live.onTurn(() => this.turned());
    const outgrow = () => {
      const { channel, stale } = this.state.value;
      if (channel && !stale && this.filmHasMoreSamples()) this.state.update((state) => ({ ...state, stale: true }));
    };
    this.unlisten = live.onTile((tile) => {
      layer.putTile(live.film, tile);
      outgrow();
    });
    this.unfill = live.onFill(() => {
      if (layer.film === live.film && !layer.image) layer.upload();
      if (!this.alpha) layer.setCoverage(live.film);
      outgrow();
    });
    layer.setFilm(live.film);
    /** @type {AlphaPlane | null} */
    this.alpha = live.isTransparent ? new AlphaPlane(live, layer) : null;
    if (!this.alpha) layer.setCoverage(live.film);
  }

  /** The film whose values are shown; null for a plane. */
  get film() {
    const { channel } = this.state.value;
    if (this.played) return this.played.total ? this.played : null; // a played frame has no samples of its own
    return channel === "" ? this.live.film : hasWords(channel) ? this.fetched : null;
  }

  /** Whether the film has more samples than the shown picture, even if they arrived as a snapshot. */
  filmHasMoreSamples() {
    return this.live.film.total > this.madeOf;
  }

  /** Whether to refresh automatically. Denoising takes a worker's time, so only after the last samples; previews have their own rule. */
  isOld() {
    const { channel, stale, waiting, error } = this.state.value;
    if (waiting || error) return false;
    if (channel === DENOISED_MIX && !this.live.isRendering && !this.hasCleanPlanes) return true;
    if (channel !== DENOISED) return stale;
    if (this.live.isRendering || this.live.film.total === 0) return false;
    return this.isPreview || this.madeOf === Infinity || (stale && this.live.finished);
  }

  /** Whether a preview is to be fetched: of every tile, better than what is shown (also than the picture that the job began with), and while the page is seen. */
  isPreviewDue() {
    const { channel, waiting } = this.state.value;
    const { film, look, worth = 0, isAgain, isRendering } = this.live;
    const isSoon = performance.now() < this.previewAt && film.total < this.previewFrom;
    if (channel !== DENOISED || !isRendering || waiting || document.hidden || isSoon) return false;
    if (this.madeOf !== Infinity) return film.total >= this.madeOf * (this.madeOf < ROUGH_PREVIEW_SAMPLES * film.width * film.height ? ROUGH_PREVIEW_GROWTH : PREVIEW_GROWTH);
    const { least, waited } = this.coverage();
    if (least === 0) return false;
    if (isAgain && look) return film.total >= look.total;
    return least >= Math.max(worth, worth < 1 ? 0 : LEAST_SPP) || (least >= LEAST_SPP && waited > SOON_MS) || waited > AT_LAST_MS;
  }

  /** Whether the film is to be shown with its noise, since no denoised picture has come in time. An earlier picture stays. */
  isNoiseDue() {
    const { film, look, clean, worth = 0, isAgain } = this.live;
    if (look && !look.isDenoised && perPixel(film) > perPixel(look)) return true;
    const { waited } = this.coverage();
    const isStale = worth < 1 && Boolean(look || clean);
    return !isAgain && waited > (isStale ? STALE_MS : worth < CLEAR ? NOISE_AFTER_MS : NOISE_AT_LAST_MS);
  }

  /** Returns the least samples per pixel of all tiles, and the time in milliseconds since every tile has some, or since the film of a job that has stopped is here. */
  coverage() {
    const { film, side = 0, isRendering } = this.live;
    const least = side > 0 ? Math.min(...film.tileSamples(side)) : 0;
    const isCovered = least > 0 || (!isRendering && film.total > 0);
    this.coveredAt = isCovered ? (this.coveredAt ?? performance.now()) : undefined; // another frame starts again
    return { least, waited: performance.now() - (this.coveredAt ?? Infinity) };
  }

  /** Fetches a denoised picture that is due; until the first has come, shows the film where it is better than what stands in for it. */
  lookAgain() {
    const { film } = this.live;
    const isHeldBack = this.state.value.channel === DENOISED && !this.fetched && this.layer.film !== film;
    const isShown = isHeldBack && this.isNoiseDue();
    if (isShown) this.layer.setFilm(film, { fades: true });
    const spp = this.showsNoise() ? Math.floor(perPixel(film)) : 0;
    if (isShown || spp !== this.toldSpp) this.state.update((state) => ({ ...state }));
    this.toldSpp = spp;
    const { isPreview, isLast } = this.state.value;
    if (isPreview && !isLast && this.live.isRendering === false) this.state.update((state) => ({ ...state, isLast: true })); // it is not renewed again
    if (this.goesOn()) {
      this.fetching.abort();
      this.state.update((state) => ({ ...state, waiting: false, isFinal: false, isPreview: true, isLast: false }));
    }
    if (this.isPreviewDue() || this.isLastDue()) void this.fetch();
  }

  /** Whether the job has ended while a preview is shown, so that its last picture is to be denoised at once, in place of a preview that is being made. */
  isLastDue() {
    const { waiting, isFinal = false, error } = this.state.value;
    if (!this.isPreview || !this.fetched || this.live.isRendering) return false;
    return this.isOld() || (this.state.value.channel === DENOISED && waiting && !isFinal && !error);
  }

  /** Whether a paused job renders again, so that previews are to come rather than the picture of the samples that it had. */
  goesOn() {
    const { channel, waiting, isFinal = false } = this.state.value;
    return channel === DENOISED && waiting && isFinal && this.live.isRendering === true;
  }

  /** Whether what is shown in place of the denoised picture still has its noise. */
  awaitsDenoised() {
    return this.state.value.channel === DENOISED && !this.fetched && this.layer.film?.isDenoised === false;
  }

  /** Whether the film is shown with its noise until it is denoised. */
  showsNoise() {
    return this.awaitsDenoised() && this.layer.film === this.live.film;
  }

  /** Whether the picture of an earlier job is shown. */
  showsEarlier() {
    return this.live.isAgain === true && this.layer.film === this.live.look;
  }

  /** Whether the picture that the job began with is shown: that of the live view or of its preview mesh. */
  showsStart() {
    const { look, clean } = this.live;
    if (this.state.value.channel !== DENOISED || this.fetched) return false;
    return look ? this.layer.film === look : Boolean(clean) && this.layer.film?.isBlank === true;
  }

  /** Whether a mix is shown with its noise. */
  showsRawMix() {
    return this.state.value.channel === DENOISED_MIX && !this.hasCleanPlanes;
  }

  /** Whether nothing of the picture is there yet, nor something that stands in for it. */
  isEmpty() {
    const { film, hasPoster } = this.live;
    return !hasPoster && !this.fetched && !this.layer.image && film.total === 0 && !this.showsStart();
  }

  /** Samples per pixel of the denoised picture that is shown while the job renders, or of an older one; null for other pictures. */
  previewSpp() {
    const { film, isRendering } = this.live;
    if (this.state.value.channel !== DENOISED || !this.fetched || !Number.isFinite(this.madeOf)) return null;
    if (!isRendering && film.total <= this.madeOf) return null;
    return Math.max(1, Math.floor(this.madeOf / (film.width * film.height)));
  }

  /** Whether the last denoised picture of the job is still to come. */
  awaitsLast() {
    const { channel, error } = this.state.value;
    if (channel !== DENOISED || error) return false;
    if (!this.fetched) return !this.live.isDenoisedStored; // which comes in a moment
    return this.isPreview || this.previewSpp() !== null;
  }

  /** Leaves a picture's poster, whose noise is not visible, in the place of a film that is not here yet, until it is denoised. */
  holdPoster() {
    const { film, hasPoster } = this.live;
    if (!hasPoster || !(film.isBlank || film.isPartial)) return;
    this.layer.setFilm(new Film(film.width, film.height));
  }

  /** What is shown until the first denoised picture has come: not the noise, if something better was shown before. */
  standIn() {
    const { film, look, hasPoster } = this.live;
    if (look) return look;
    return hasPoster && !this.live.finished ? new Film(film.width, film.height) : film;
  }

  /** @param {string} channel @param {readonly import("./light-mix.js").Strip[]} [mix] of the channel MIX */
  choose(channel, mix = []) {
    const isNew = mix !== this.mix;
    this.mix = mix;
    if (channel === this.state.value.channel) {
      if (isNew && this.planes) this.mixing ||= requestAnimationFrame(() => this.remix());
      return;
    }
    this.fetching.abort();
    this.fetched = null;
    this.planes = null;
    this.hasCleanPlanes = false;
    this.madeOf = Infinity;
    this.isPreview = false;
    if (channel === DENOISED && this.live.isRendering) {
      this.layer.setFilm(this.standIn());
      this.state.set({ channel, waiting: false, stale: false, error: null, isPreview: true });
    } else if (channel) {
      if (channel === DENOISED) this.holdPoster();
      this.state.set({ channel, waiting: false, stale: false, error: null });
      void this.fetch();
    } else {
      this.played = null;
      this.layer.setFilm(this.live.film);
      this.state.set({ channel, waiting: false, stale: false, error: null });
    }
  }

  /** @param {Film | null} film shown instead of the live one; null: that again */
  play(film) {
    if (film === this.played) return;
    this.played = film;
    if (this.state.value.channel === "") this.layer.setFilm(film ?? this.live.film);
  }

  /** Called after a change of frame. Fetching is delayed until no further change follows. */
  turned() {
    const { channel } = this.state.value;
    if (channel === "") {
      if (this.played) this.play(null);
      else if (this.layer.film === this.live.film) this.layer.upload();
      else this.layer.setFilm(this.live.film);
      return;
    }
    this.fetching.abort();
    this.hasCleanPlanes = false;
    this.madeOf = Infinity;
    this.state.set({ channel, waiting: true, stale: false, error: null });
    clearTimeout(this.settling);
    this.settling = setTimeout(() => void this.fetch(), SETTLE_MS);
  }

  /** Shows the loaded planes with the gains of the mix, without fetching anything. */
  remix() {
    this.mixing = 0;
    if (!this.planes || !this.fetched) return;
    mixWords(this.planes, gainsOf(this.mix), this.fetched.words);
    this.layer.upload();
    this.state.update((state) => ({ ...state }));
  }

  /** Fetches the channel; the shown picture stays until it arrives. */
  async fetch() {
    const { channel } = this.state.value;
    this.fetching.abort();
    const { signal } = (this.fetching = new AbortController());
    // Also of a job that has ended, a preview is first if nothing denoised is shown yet: the picture itself takes several times as long.
    const wantsPreview = channel === DENOISED && (this.live.isRendering === true || (!this.fetched && this.live.isRendering === false));
    this.state.update((state) => ({ ...state, waiting: true, error: null, isPreview: wantsPreview, isFinal: channel === DENOISED && !wantsPreview, isLast: !this.live.isRendering, isImproved: channel === DENOISED && this.fetched !== null }));
    try {
      if (isMix(channel)) {
        if (!this.hasCleanPlanes) await this.fetchPlanes({}, signal);
        // Each group is denoised once, when the job has ended; mixing needs no worker.
        if (channel === DENOISED_MIX && !this.live.isRendering) await this.fetchPlanes({ denoise: "true" }, signal);
      } else if (hasWords(channel)) {
        const { width, height } = this.live.film;
        /** @type {Record<string, string>} */
        const wish = channel === DENOISED ? { denoise: "true", ...(wantsPreview && { preview: "true" }) } : { aov: channel };
        const show = (/** @type {Awaited<ReturnType<typeof fetchWords>>} */ { words, samples, isPreview }) => {
          if (signal.aborted) return;
          this.isPreview = isPreview;
          const isUnchanged = samples === this.madeOf; // the farm made no other yet
          this.previewAt = performance.now() + (isUnchanged ? EVERY_MS : 0);
          this.previewFrom = isUnchanged && this.live.film.total < UNRESTED_PREVIEW_GROWTH * samples ? UNRESTED_PREVIEW_GROWTH * samples : Infinity;
          this.madeOf = samples;
          this.fetched = new Film(width, height, words);
          this.layer.setFilm(this.fetched, { fades: channel === DENOISED });
          const spp = isPreview ? Math.max(1, Math.floor(samples / (width * height))) : undefined;
          this.state.update((state) => ({ ...state, isPreview, spp }));
        };
        // A stored one is shown at once; a better one has to wait for a worker.
        if (wantsPreview && !this.fetched && this.live.isDenoisedStored) await fetchWords(this.live, { ...wish, wait: "false" }, signal).then(show, () => {});
        if (!signal.aborted) show(await fetchWords(this.live, wish, signal));
      } else {
        const { image, samples, span } = await fetchImage(this.live, { aov: channel }, signal);
        if (signal.aborted) return image.close();
        this.state.update((state) => ({ ...state, span }));
        this.madeOf = samples;
        this.layer.setImage(image);
      }
    } catch (error) {
      if (signal.aborted) return;
      this.previewAt = performance.now() + FAILED_MS;
      this.previewFrom = Infinity;
      if (channel === DENOISED && !this.fetched) this.layer.setFilm(this.live.film);
      this.state.update((state) => ({ ...state, error }));
    } finally {
      if (!signal.aborted) this.state.update((state) => ({ ...state, waiting: false, stale: this.filmHasMoreSamples() }));
    }
  }

  /** Fetches and shows the planes of a mix. @param {Record<string, string>} wish parameters of the planes @param {AbortSignal} signal */
  async fetchPlanes(wish, signal) {
    const { width, height } = this.live.film;
    const planes = await Promise.all(this.mix.map(({ name }) => fetchWords(this.live, { aov: channelOfLight(name), ...wish }, signal)));
    if (signal.aborted) return;
    this.madeOf = Math.min(...planes.map(({ samples }) => samples));
    this.planes = planes.map(({ words }) => words);
    this.hasCleanPlanes = "denoise" in wish;
    this.fetched = new Film(width, height, new Uint32Array(width * height));
    mixWords(this.planes, gainsOf(this.mix), this.fetched.words);
    this.layer.setFilm(this.fetched, { fades: this.hasCleanPlanes });
    this.state.update((state) => ({ ...state }));
  }

  dispose() {
    clearInterval(this.timer);
    clearInterval(this.previewTimer);
    clearTimeout(this.settling);
    cancelAnimationFrame(this.mixing);
    this.unturn();
    this.fetching.abort();
    this.alpha?.dispose();
    this.unlisten();
    this.unfill();
    this.layer.clear();
  }
}

/** @param {Film} film */
const perPixel = ({ total, width, height }) => total / (width * height);
