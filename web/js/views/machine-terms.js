/** Working hours and limits of a machine, applied while it runs. Collapsed, since they are rarely changed. */

import { askWorker } from "../news/api.js";
import { h, setText } from "../base/dom.js";
import { field } from "../forms/fields.js";
import { may } from "../news/session.js";
import { saidOf } from "../base/said.js";
import { t } from "../base/words.js";
import { announce, showError } from "../shell/tray.js";

/** @typedef {import("../base/types.js").Worker} Worker */

const GB = 1e9;

/** @returns {{element: HTMLElement, update: (worker: Worker) => void}} */
export function machineTerms() {
  /** @type {Worker | null} */
  let latest = null;
  const hours = h("input", { type: "text", placeholder: t("always"), maxLength: 500, spellcheck: "false", autocomplete: "off" });
  const idle = h("input", { type: "number", min: 0, max: 1000000, step: "any", placeholder: t("not required") });
  const slots = h("input", { type: "number", min: 1, max: 4096, step: 1 });
  const memory = h("input", { type: "number", min: 0, max: 1000000, step: "any", placeholder: t("no limit") });
  const nice = h("input", { type: "number", min: 0, max: 19, step: 1 });
  /** @type {[HTMLInputElement, () => Parameters<typeof askWorker>[1]][]} */
  const asks = [
    [hours, () => ({ hours: hours.value.trim() })],
    [idle, () => ({ idle_minutes: Number(idle.value) })],
    [slots, () => ({ slots: slots.value ? Number(slots.value) : null })],
    [memory, () => ({ memory_gb: Number(memory.value) })],
    [nice, () => ({ nice: nice.value ? Number(nice.value) : null })],
  ];
  for (const [input, terms] of asks) {
    input.disabled = !may("admin");
    input.addEventListener("change", () => {
      if (!latest || !input.validity.valid) return;
      askWorker(latest.name, terms()).then(
        () => announce(t("Takes effect within seconds")),
        (error) => showError(t("{name} could not be reached", { name: latest?.name ?? "" }), error, { ofPage: true }),
      );
    });
  }
  const tags = h("p", { class: "small tags" });
  const by = h("p", { class: "quiet small" });
  const trouble = h("p", { class: "small trouble", role: "status" });
  const fields = h(
    "div",
    { class: "terms" },
    field(t("Hours"), hours, t("For example Mon-Fri 19:00-07:00, Sat-Sun, by the machine's clock.")),
    field(t("Idle for, minutes"), idle, t("Works only if nobody has used the machine for this long.")),
    field(t("Max slots"), slots),
    field(t("Memory, GB"), memory),
    field(t("Nice level"), nice, t("0 to 19: a higher value yields more to other programs.")),
    by,
  );
  const old = h("p", { class: "quiet small", hidden: true }, t("It runs an older release, so it can only be paused."));
  const element = h("details", { class: "machine-terms" }, h("summary", null, t("Hours and limits")), fields, old);
  const whole = h("div", { class: "stack tight" }, tags, trouble, element);
  return {
    element: whole,
    update(worker) {
      latest = worker;
      const { offer } = worker;
      fields.hidden = !offer;
      old.hidden = Boolean(offer);
      const named = offer?.tags.filter((tag) => !/^(kind|host):/.test(tag)) ?? [];
      tags.hidden = named.length === 0;
      setText(tags, named.length ? t("Tags: {tags}", { tags: named.join(", ") }) : "");
      setText(trouble, saidOf(offer, "trouble"));
      trouble.hidden = !offer?.trouble;
      if (!offer) return;
      put(hours, offer.hours);
      put(idle, offer.idle_minutes ? String(offer.idle_minutes) : "");
      put(slots, String(worker.slots));
      slots.max = String(offer.slots_most);
      put(memory, offer.memory_limit ? String(offer.memory_limit / GB) : "");
      put(nice, String(offer.nice));
      by.hidden = !offer.idle_minutes;
      setText(by, offer.idle_by.length ? t("Detects use by: {ways}", { ways: offer.idle_by.map((way) => WAYS[way] ?? way).join(", ") }) : t("Cannot detect whether the machine is in use."));
    },
  };
}

/** @type {Record<string, string>} */
const WAYS = { load: t("load of other programs"), terminals: t("terminals"), desktop: t("the desktop"), screen: t("screen and keyboard") };

/** Does not overwrite a field that has focus. @param {HTMLInputElement} input @param {string} value */
function put(input, value) {
  if (input !== document.activeElement && input.value !== value) input.value = value;
}
