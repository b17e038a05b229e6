/** The collapsible section of a new job's queue options and reuse of samples. Shows a summary while collapsed. */

import { h, setText } from "../base/dom.js";
import { t, tn } from "../base/words.js";
import { afterField } from "./after-field.js";
import { field } from "./fields.js";
import { queueFields } from "./queue-fields.js";

/** @typedef {import("../base/types.js").JobRequest} JobRequest */

/**
 * @param {{needs?: string[]} | null} like an earlier job of the same scene, whose requirements are the initial values
 * @returns {{element: HTMLDetailsElement, get: () => Partial<JobRequest>, dispose: () => void}}
 */
export function queueFold(like) {
  const told = h("span", { class: "quiet small told" });
  const place = queueFields(() => tell());
  const after = afterField(() => tell());
  const verify = h("input", { type: "number", min: 0, max: 100, step: "any", inputmode: "decimal", placeholder: t("farm default") });
  const fresh = h("input", { type: "checkbox" });
  if (like?.needs?.length) place.put({ needs: like.needs });
  const get = () => ({
    ...place.get(),
    ...(after.get().length > 0 && { after: after.get() }),
    ...(verify.value && { verify: verify.valueAsNumber / 100 }),
    ...(fresh.checked && { fresh: true }),
  });
  const tell = () => setText(told, wordsOf(get()));
  for (const input of [verify, fresh]) input.addEventListener("change", tell);
  const element = h(
    "details",
    { class: "queue-fold" },
    h("summary", null, h("span", { class: "title" }, t("Queue")), told),
    h(
      "div",
      { class: "stack" },
      place.elements,
      after.element,
      field(t("Verified, %"), verify, t("Share of the samples that two workers render and that are compared bit by bit.")),
      h(
        "label",
        { class: "check small", title: t("Otherwise samples of an earlier job of the same picture are reused") },
        fresh,
        t("Render again from the first sample"),
      ),
    ),
  );
  tell();
  return { element, get, dispose: after.dispose };
}

/** Summarises the options in a few words. @param {Partial<JobRequest>} asked */
function wordsOf({ deadline, priority, max_slots, needs, after, verify, fresh }) {
  const parts = [];
  if (deadline) parts.push(t("by {time}", { time: new Date(deadline).toLocaleString([], { weekday: "short", hour: "2-digit", minute: "2-digit" }) }));
  if (priority) parts.push(t("priority {n}", { n: priority }));
  if (max_slots) parts.push(tn(max_slots, "{n} slot", "{n} slots"));
  if (needs?.length) parts.push(needs.join(", "));
  if (after?.length) parts.push(tn(after.length, "after {n} job", "after {n} jobs"));
  if (verify) parts.push(t("{n} % verified", { n: Number((verify * 100).toPrecision(3)) }));
  if (fresh) parts.push(t("anew"));
  return parts.join(" · ");
}
