/** Intermediate pictures at 1, 2, 4, 8 ... samples per pixel, shown on the stage instead of the current one. */

import { fetchPacket, getSnapshots, snapshotUrl } from "../news/api.js";
import { fill, h, setText } from "../base/dom.js";
import { clock, count } from "../base/format.js";
import { Film } from "../film/film.js";
import { icon } from "../base/icons.js";
import { here, linkTo, setParams } from "../shell/router.js";
import { announce } from "../shell/tray.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").Snapshot} Snapshot */

const RENEW_MS = 3000;
/** States in which pictures may still be recorded. */
const OPEN = ["queued", "running", "paused"];
/** Number of steps from which only every second is labelled. */
const CROWDED = 7;

/**
 * @param {() => Job} job
 * @param {import("../film/live-picture.js").LivePicture} picture
 * @param {import("../base/store.js").Store<import("./display-panel.js").Display>} display
 * @param {import("../base/store.js").Disposer} life
 */
export function momentsPanel(job, picture, display, life) {
  const slider = h("input", { type: "range", min: "0", step: "1", "aria-label": t("Moment") });
  const ticks = h("div", { class: "moment-ticks quiet small number", "aria-hidden": "true" });
  const said = h("p", { class: "quiet small number", role: "status" });
  const fewer = h("button", { class: "icon-button", type: "button", "aria-label": t("Fewer samples"), title: t("Fewer samples (,)"), onclick: () => step(-1) }, icon("back"));
  const more = h("button", { class: "icon-button", type: "button", "aria-label": t("More samples"), title: t("More samples (.)"), onclick: () => step(1) }, icon("next"));
  const now = h("button", { class: "text-button small", type: "button", onclick: () => goTo(null) }, t("Back to now"));
  const compare = h("a", null, t("Compare with now"));
  const exr = h("a", { download: "" }, "EXR");
  const links = h("p", { class: "row wraps small", hidden: true }, now, compare, exr);
  const tag = h("div", { class: "channel-tag alone", hidden: true });
  picture.element.append(tag);
  const element = h(
    "section",
    { class: "side-section stack tight moments", "aria-label": t("Sample history") },
    h("div", { class: "row" }, h("h2", null, t("Sample history")), h("span", { class: "grow" }), fewer, more),
    slider,
    ticks,
    said,
    links,
  );
  /** @type {Snapshot[]} */
  let known = [];
  /** Samples per pixel; null: the current picture. @type {number | null} */
  let at = Number(here().params.get("then")) || null;
  /** What was shown before the first step into the past. @type {Pick<import("./display-panel.js").Display, "channel" | "denoise"> | null} */
  let before = null;
  /** Loaded snapshots. @type {Map<number, Promise<Film>>} */
  const films = new Map();
  const abort = new AbortController();
  life.add(() => abort.abort());

  const filmAt = (/** @type {number} */ spp) => {
    const found = films.get(spp) ?? fetchFilm(spp);
    films.set(spp, found);
    found.catch(() => films.delete(spp));
    return found;
  };
  const fetchFilm = async (/** @type {number} */ spp) => {
    const packet = await fetchPacket(snapshotUrl(job().id, spp, "film"), abort.signal);
    const film = new Film(packet.width, packet.height);
    film.take(packet);
    return film;
  };
  const show = async () => {
    const snapshot = known.find(({ spp }) => spp === at);
    slider.max = String(known.length);
    slider.valueAsNumber = snapshot ? known.indexOf(snapshot) : known.length;
    const isRaw = (before?.denoise ?? (job().denoise ? "on" : "off")) !== "off"; // the current picture is denoised, and this one is not
    const name = snapshot ? wordsOf(snapshot, isRaw) : t("Current");
    slider.setAttribute("aria-valuetext", name);
    fewer.disabled = slider.valueAsNumber === 0;
    more.disabled = !snapshot;
    setText(said, name);
    links.hidden = !snapshot;
    tag.hidden = !snapshot;
    const taken = snapshot ? tn(snapshot.spp, "{n} sample", "{n} samples", { n: count(snapshot.spp) }) : "";
    setText(tag, taken && isRaw ? t("{picture}, not denoised", { picture: taken }) : taken);
    if (!snapshot) {
      picture.side()?.play(null);
      return;
    }
    compare.href = `${linkTo("compare", job().id, job().id)}?ta=${snapshot.spp}`;
    exr.href = snapshotUrl(job().id, snapshot.spp, "image.exr");
    try {
      const film = await filmAt(snapshot.spp);
      if (at === snapshot.spp && !abort.signal.aborted) picture.side()?.play(film);
    } catch (error) {
      if (at === snapshot.spp && !abort.signal.aborted) setText(said, error instanceof Error ? error.message : String(error));
    }
  };
  /** @param {number | null} spp samples per pixel of a snapshot; null: the current picture */
  const goTo = (spp) => {
    const { channel, denoise } = display.value;
    if (at === null && spp !== null) before = { channel, denoise };
    at = spp;
    setParams({ then: at === null ? null : String(at) });
    const shown = at === null ? before : { channel: "", denoise: /** @type {const} */ ("off") }; // snapshots contain only colour
    if (shown) display.update((look) => ({ ...look, ...shown }));
    if (at === null) before = null;
    void show();
  };
  slider.addEventListener("input", () => goTo(known[slider.valueAsNumber]?.spp ?? null));
  const step = (/** @type {number} */ by) => {
    if (known.length === 0) return;
    goTo(known[Math.min(Math.max(slider.valueAsNumber + by, 0), known.length)]?.spp ?? null);
    announce(said.textContent ?? "");
  };
  // Planes and the denoised picture exist only for the current picture.
  life.add(
    display.subscribe(({ channel, denoise }) => {
      if (at === null || (channel === "" && denoise === "off")) return;
      at = before = null;
      setParams({ then: null });
      void show();
    }),
  );
  const renew = async () => {
    try {
      const found = await getSnapshots(job().id, abort.signal);
      if (JSON.stringify(found) === JSON.stringify(known)) return showKnown();
      known = found;
    } catch {
      return; // connection lost or job deleted, as shown elsewhere
    }
    showKnown();
    void show();
  };
  const showKnown = () => {
    element.hidden = known.length === 0 && !OPEN.includes(job().state);
    // One picture is no choice; the room stays, since more come while it renders.
    for (const part of [slider, ticks, fewer, more]) part.style.visibility = known.length === 0 ? "hidden" : "";
    fill(ticks, ...[...known.map(({ spp }, i) => ((known.length - i) % 2 === 0 || known.length < CROWDED ? shortOf(spp) : "")), t("now")].map((text) => h("span", null, text)));
  };
  showKnown();
  void show();
  void renew();
  life.every(RENEW_MS, () => job().state === "running" && void renew());
  let state = job().state;
  return {
    element,
    goTo,
    /**
     * @param {number} sample number of a sample
     * @returns {{without: number | null, with: number | null}} the last snapshot in which no tile has the sample, and the first in
     *   which all have it
     */
    around: (sample) => ({
      without: known.findLast(({ most }) => most <= sample)?.spp ?? null,
      with: known.find(({ least }) => least > sample)?.spp ?? null,
    }),
    /** @type {import("../shell/shortcuts.js").Shortcut[]} */
    keys: [
      { keys: ",", does: t("Sample history: the picture with fewer samples"), run: () => step(-1) },
      { keys: ".", does: t("Sample history: the picture with more samples"), run: () => step(1) },
    ],
    update: (/** @type {Job} */ next) => {
      if (next.state !== state) void renew();
      state = next.state;
    },
  };
}

/** @param {number} spp */
const shortOf = (spp) => (spp < 1024 ? String(spp) : `${spp / 1024}k`);

/** @param {Snapshot} snapshot @param {boolean} isRaw whether the current picture is denoised, and this one is not */
function wordsOf({ spp, least, most, seconds }, isRaw) {
  const time = seconds < 60 ? t("{n} s", { n: Math.max(1, Math.round(seconds)) }) : clock(seconds);
  const taken = tn(spp, "{n} sample per pixel, after {time}", "{n} samples per pixel, after {time}", { n: count(spp), time });
  const whole = least === most && least === spp ? taken : `${taken}; ${t("{least} to {most} per tile", { least: count(least), most: count(most) })}`;
  return isRaw ? t("{picture}. Only the current picture is denoised.", { picture: whole }) : whole;
}
