/** A machine of the farm: the work of its slots, its state, and actions. */

import { lookOfJob } from "../film/job-look.js";
import { changeWorker, getWorkerLog, imageUrl, thumbnailFormat } from "../news/api.js";
import { QUARANTINED, hasCode } from "../base/codes.js";
import { fill, h, keyedList, setText } from "../base/dom.js";
import { jobs } from "../news/farm.js";
import { bytes, compact } from "../base/format.js";
import { icon } from "../base/icons.js";
import { linkTo } from "../shell/router.js";
import { machineTerms } from "./machine-terms.js";
import { lastHour } from "./last-hour.js";
import { stateChip } from "../shell/state-chip.js";
import { showError } from "../shell/tray.js";
import { allSaidOf, saidOf } from "../base/said.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Worker} Worker */
/** @typedef {Worker["current"][number]} Slot */

const PICTURE_EVERY_MS = 5000;

/** @returns {import("../base/dom.js").Row<Worker>} */
export function machineCard() {
  const name = h("h2", { class: "name" });
  const cpu = h("p", { class: "quiet small cpu" });
  const chip = stateChip("starting");
  const why = h("p", { class: "small why" });
  const speed = h("dd");
  const memory = h("dd");
  const gauge = h("div", { class: "gauge", "aria-hidden": "true" }, h("div"));
  const failures = h("dd");
  const hour = lastHour();
  const peak = h("dt");
  const cards = h("ul", { class: "small graphics-cards" });
  const slots = h("ul", { class: "slot-tiles" });
  const showSlots = keyedList(
    slots,
    (/** @type {{key: string, slot: Slot}} */ { key }) => key,
    () => slotTile(),
  );
  const terms = machineTerms();
  const button = h("button", { class: "button small", type: "button", onclick: () => turn() });
  const log = h("details", { class: "log", ontoggle: () => showLog() }, h("summary", null, t("Log")), h("pre", { tabindex: "0" }));
  const lines = /** @type {HTMLElement} */ (log.lastElementChild);
  /** @type {Worker | null} */
  let latest = null;
  let isPaused = false; // paused by a user, not by its own hours

  const turn = async () => {
    if (!latest) return;
    button.disabled = true;
    try {
      update(await changeWorker(latest.name, isPaused ? "running" : "paused"));
    } catch (error) {
      showError(t("{name} could not be reached", { name: latest.name }), error, { ofPage: true });
    } finally {
      button.disabled = false;
    }
  };
  const showLog = async () => {
    if (!log.open || !latest) return;
    setText(lines, t("Asking the worker …"));
    try {
      setText(lines, (await getWorkerLog(latest.name)).join("\n") || t("No log lines yet."));
      lines.scrollTop = lines.scrollHeight;
    } catch (error) {
      setText(lines, error instanceof Error ? error.message : String(error));
    }
  };

  /** @param {Worker} worker */
  const update = (worker) => {
    latest = worker;
    const busy = worker.current.filter((slot) => Object.keys(slot).length > 0).length;
    const isAside = worker.state === "paused" && hasCode(worker.codes?.["message"], QUARANTINED);
    const rests = worker.state === "paused" && Boolean(worker.offer?.rests) && worker.message === worker.offer?.rests;
    const state = isAside ? "set-aside" : worker.state === "paused" && busy ? "draining" : rests ? "resting" : worker.state;
    isPaused = worker.state === "paused" && !rests;
    terms.update(worker);
    setText(name, worker.name);
    name.title = worker.name;
    setText(cpu, worker.transport === "https" ? t("{cpu}, over HTTPS", { cpu: worker.cpu }) : worker.cpu);
    cpu.title = worker.cpu;
    chip.update(state);
    const draining = busy ? tn(busy, " {n} slot is finishing its current work.", " {n} slots are finishing their current work.") : "";
    setText(why, worker.state === "paused" ? `${saidOf(worker, "message")}${draining}` : "");
    const now = speedOf(worker);
    setText(speed, now ? t("{n} samples/s", { n: compact(now) }) : busy ? t("No job") : "–"); // its slots say that they are idle
    speed.title = !now && busy ? t("Its slots work for live views, or prepare or denoise something.") : "";
    const { speeds: known = [] } = worker;
    const speeds = [...known.slice(0, -1), Math.max(now, known.at(-1) ?? 0)]; // the last is of this minute
    const most = Math.max(...speeds);
    setText(peak, most ? t("Last hour, up to {n}/s", { n: compact(most) }) : t("Last hour"));
    hour.update(speeds);
    const { memory_used: used, memory_total: total } = worker;
    setText(memory, used != null && total ? t("{done} of {all}", { done: bytes(used), all: bytes(total) }) : t("not reported"));
    gauge.hidden = used == null || !total;
    if (used != null && total) {
      /** @type {HTMLElement} */ (gauge.firstElementChild).style.transform = `scaleX(${Math.min(1, used / total)})`;
      gauge.classList.toggle("full", used / total > 0.9);
    }
    showCards(cards, worker);
    setText(failures, worker.failures ?? 0);
    failures.classList.toggle("bad", (worker.failures ?? 0) > 0);
    const all = Array.from({ length: worker.slots }, (_, i) => ({ key: String(i), slot: worker.current[i] ?? {} }));
    showSlots(all);
    fill(button, icon(isPaused ? "play" : "pause"), isPaused ? t("Resume") : t("Pause"));
    button.title = isPaused ? t("Accepts work again") : t("Finishes its current work and takes no more");
  };
  const fact = (/** @type {string} */ title, /** @type {HTMLElement[]} */ ...shown) => h("div", null, h("dt", null, title), ...shown);
  return {
    element: h(
      "li",
      { class: "machine" },
      h("header", null, h("div", null, name, cpu), chip.element),
      why,
      h(
        "dl",
        { class: "vitals number" },
        fact(t("Speed"), speed),
        h("div", null, peak, hour.element),
        fact(t("Memory"), memory, gauge),
        fact(t("Failures"), failures),
      ),
      cards,
      slots,
      terms.element,
      h("footer", { class: "for-admin" }, button, log),
    ),
    update,
  };
}

/** Returns the samples per second of a machine's slots that render now; 0: none does. @param {Worker} worker */
export const speedOf = ({ current, samples_per_s: ofSlot }) => ofSlot * current.filter(({ batch, compiling }) => batch && !compiling).length;

/**
 * Shows the graphics cards of a machine: those that render, and why others do not.
 *
 * @param {HTMLElement} list
 * @param {Worker} worker
 */
function showCards(list, worker) {
  const used = (worker.cards ?? []).map(({ number, name, memory, samples_per_s: speed }) => {
    const size = `${Math.round(memory / 2 ** 30)} GiB`; // in the unit of the reasons and of the makers
    const card = [name, size, speed ? t("{n} samples/s", { n: compact(speed) }) : ""].filter(Boolean).join(" · ");
    return t("Renders with card {number}: {card}", { number, card });
  });
  const unused = allSaidOf(worker, "cards_unused");
  list.hidden = used.length + unused.length === 0;
  fill(
    list,
    ...used.map((text) => h("li", null, text)),
    ...unused.map((text) => h("li", { class: "quiet" }, text)),
  );
}

/** @returns {import("../base/dom.js").Row<{key: string, slot: Slot}>} */
function slotTile() {
  const image = h("img", { alt: "", hidden: true });
  image.addEventListener("load", () => (image.hidden = false));
  image.addEventListener("error", () => (image.hidden = true));
  const box = h("div", { class: "tile-box", hidden: true });
  const rest = h("span", { class: "rest" });
  const frame = h("div", { class: "frame" }, image, box, rest);
  const label = h("span", { class: "small" });
  const element = h("li", null, frame, label);
  let pictureOf = "";
  return {
    element,
    update({ key, slot }) {
      const job = jobs.value?.find(({ id }) => id === slot.job);
      const isIdle = Object.keys(slot).length === 0;
      const word = isIdle ? t("Idle") : wordOf(slot);
      rest.hidden = word === "";
      setText(rest, word);
      sayWhere(label, slot, job?.name, key);
      const isKnown = Boolean(job?.width && job.height);
      frame.style.aspectRatio = isKnown ? `${job?.width} / ${job?.height}` : "";
      const [x, y, w, tall] = slot.tile ?? [];
      box.hidden = !isKnown || w === undefined;
      if (job?.width && job.height && w !== undefined) {
        box.style.left = `${(100 * x) / job.width}%`;
        box.style.top = `${(100 * y) / job.height}%`;
        box.style.width = `${(100 * w) / job.width}%`;
        box.style.height = `${(100 * tall) / job.height}%`;
      }
      // Slots that work on the same picture share one request, since the URLs are equal.
      const turn = Math.floor(Date.now() / PICTURE_EVERY_MS);
      const shown = job && job.samples > 0 ? { job: job.id, frame: slot.frame ?? 0 } : null;
      const of = shown ? `${shown.job} ${shown.frame}` : "";
      if (of !== pictureOf) {
        pictureOf = of;
        image.hidden = true; // otherwise the previous picture would briefly show under another name
        image.removeAttribute("src");
      }
      const source = shown && imageUrl(shown, thumbnailFormat(job), { width: 320, ...lookOfJob(job), v: turn });
      if (source && !document.hidden && image.getAttribute("src") !== source) image.src = source;
    },
  };
}

/** Returns the word that stands in the place of a slot's picture; "" if it renders a job, or prepares a scene, as its label says. @param {Slot} slot */
function wordOf(slot) {
  if (slot.view) return t("Live view"); // its picture is not stored
  if (slot.job || slot.scene || slot.hidden) return "";
  return slot.denoise ? t("Denoises") : slot.vectors ? t("Motion vectors") : slot.path_guide ? t("Path guide") : "";
}

/**
 * Sets the label of a slot: its job, scene or number.
 *
 * @param {HTMLElement} label
 * @param {Slot} slot
 * @param {string | undefined} name of its job
 * @param {string} key
 */
function sayWhere(label, slot, name, key) {
  const [href, text] = slot.job
    ? [linkTo("jobs", slot.job), name ?? t("A picture")]
    : slot.scene
      ? [linkTo("scenes", slot.scene), t("Prepares a scene")]
      : ["", slot.hidden ? t("Rendering for a project that you cannot see") : t("Slot {number}", { number: Number(key) + 1 })];
  const said = slot.compiling ? t("{text}, compiling", { text }) : text;
  if (label.title === `${href} ${said}`) return;
  label.title = `${href} ${said}`;
  fill(label, href ? h("a", { href }, said) : said);
  if (!href) label.classList.add("quiet");
  else label.classList.remove("quiet");
}
