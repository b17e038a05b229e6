/** Fields of a job's place in the queue: deadline, priority, maximum slots, and requirements on workers. */

import { h, setText } from "../base/dom.js";
import { t } from "../base/words.js";
import { workers } from "../news/farm.js";
import { explain, field, numberOf } from "./fields.js";

/** @typedef {{deadline?: string | null, priority?: number, max_slots?: number | null, needs?: string[]}} Place */
/** @typedef {{deadline?: number | null, priority?: number, max_slots?: number | null, needs?: string[]}} Placed */

/** Same syntax as the service's. */
const TAG = /^[a-z0-9][a-z0-9._:-]{0,62}$/;
const MEMORY = /^memory_gb=\d{1,6}(\.\d{1,3})?$/;

/**
 * @param {(part: Place) => void} changed called with the changed values, if valid, when the user changes a field
 * @returns {{elements: HTMLElement[], get: () => Place, put: (job: Placed) => void}} get: the fields of a request that are set
 */
export function queueFields(changed) {
  const deadline = h("input", { type: "datetime-local" });
  const priority = h("input", { type: "number", min: -100, max: 100, step: 1, required: true, value: "0" });
  const slots = h("input", { type: "number", min: 1, max: 1000000, step: 1, placeholder: t("no limit") });
  const needs = h("input", { type: "text", placeholder: t("any worker"), maxLength: 500, spellcheck: "false", autocomplete: "off", autocapitalize: "none" });
  const lacking = h("p", { class: "hint lacking", "aria-live": "polite", hidden: true });
  const sayLacking = () => {
    setText(lacking, lackingWords(listOf(needs)));
    lacking.hidden = !lacking.textContent;
  };
  /** @type {[HTMLInputElement, () => string, () => Place][]} */
  const all = [
    [deadline, () => (deadline.value && new Date(deadline.value) <= new Date() ? t("Deadline: this time has passed.") : ""), () => ({ deadline: isoOf(deadline.value) })],
    [priority, () => "", () => ({ priority: numberOf(priority, 0) })],
    [slots, () => "", () => ({ max_slots: slots.value ? slots.valueAsNumber : null })],
    [needs, () => problemOf(listOf(needs)), () => ({ needs: listOf(needs) })],
  ];
  for (const [input, problem, part] of all) {
    input.addEventListener("input", () => input.setCustomValidity(problem()));
    input.addEventListener("change", () => {
      input.setCustomValidity(problem());
      if (input === needs) sayLacking();
      if (input.validity.valid) changed(part());
    });
  }
  const wanted = field(t("Deadline"), deadline, t("Warns if the forecast says it will be late."));
  const needed = field(t("Needs"), needs, t("Tags of workers, such as gpu, or memory_gb=32, separated by commas."));
  needed.append(lacking);
  explain(wanted, t("Deadline"), [deadline]);
  explain(needed, t("Needs"), [needs]);
  return {
    elements: [wanted, h("div", { class: "pair" }, field(t("Priority"), priority, t("Jobs with a higher number are rendered first.")), field(t("Max slots"), slots)), needed],
    get: () => ({
      ...(deadline.value && { deadline: isoOf(deadline.value) }),
      ...(numberOf(priority, 0) !== 0 && { priority: numberOf(priority, 0) }),
      ...(slots.value && { max_slots: slots.valueAsNumber }),
      ...(listOf(needs).length > 0 && { needs: listOf(needs) }),
    }),
    put(job) {
      put(deadline, job.deadline ? localOf(job.deadline) : "");
      put(priority, String(job.priority ?? 0));
      put(slots, job.max_slots ? String(job.max_slots) : "");
      put(needs, (job.needs ?? []).join(", "));
    },
  };
}

/** Does not overwrite a field that has focus. @param {HTMLInputElement} input @param {string} value */
function put(input, value) {
  if (input === document.activeElement || input.value === value) return;
  input.value = value;
  input.setCustomValidity("");
}

/** @param {HTMLInputElement} input */
const listOf = (input) => input.value.split(",").map((need) => need.trim()).filter(Boolean);

/** @param {string[]} needs @returns {string} an error message about the first invalid requirement; empty if all are valid */
function problemOf(needs) {
  const wrong = needs.find((need) => !TAG.test(need) && !MEMORY.test(need));
  return wrong === undefined ? "" : t("Needs: “{need}” is not valid. Use tags in lower case, or memory_gb=32.", { need: wrong });
}

/** Returns a note that the job would wait, and for which requirement. @param {string[]} needs */
function lackingWords(needs) {
  const offers = (workers.value ?? []).flatMap(({ offer }) => (offer ? [offer] : []));
  const tags = needs.filter((need) => TAG.test(need));
  const missing = tags.find((tag) => !offers.some((offer) => offer.tags.includes(tag)));
  if (missing !== undefined) return t("No connected worker has {need}: the job waits for one.", { need: missing });
  const memory = needs.find((need) => MEMORY.test(need));
  const gigabytes = Number(memory?.slice("memory_gb=".length) ?? 0);
  const isThere = offers.some((offer) => tags.every((tag) => offer.tags.includes(tag)) && offer.memory >= gigabytes * 1e9);
  return needs.length && !isThere ? t("No connected worker has all of these: the job waits for one.") : "";
}

/** Formats a time for the field, in this browser's time zone. @param {number} at unix seconds */
function localOf(at) {
  const zone = new Date(at * 1000).getTimezoneOffset() * 60;
  return new Date((at - zone) * 1000).toISOString().slice(0, 16);
}

/** @param {string} local as the field has it */
const isoOf = (local) => (local ? new Date(local).toISOString() : null);
