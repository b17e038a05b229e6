/** Changes of a shot: more frames, failed frames again, more samples for some, another order. */

import { h, setText } from "../base/dom.js";
import { explain, field, numberInput, numberOf } from "../forms/fields.js";
import { icon } from "../base/icons.js";
import { change } from "../job/job-panel.js";
import { settingOf } from "../news/settings-table.js";
import { parseFrames } from "../base/frame-numbers.js";
import { partText } from "./shot-save.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../news/api.js").JobChange} JobChange */
/** @typedef {import("./shot-frames.js").ShotFrames} ShotFrames */

const MORE = 64;

/**
 * @param {() => Job} job
 * @param {ShotFrames} frames
 * @param {import("../base/store.js").Disposer} life
 * @returns {{element: HTMLElement, update: () => void}}
 */
export function shotEdit(job, frames, life) {
  /** Resumes the job, since samples need a running one. @param {JobChange} wish @param {string} failure */
  const apply = (wish, failure) => {
    const stopped = job().state === "cancelled" || job().state === "failed";
    return change(job(), { ...wish, ...(stopped && { state: /** @type {const} */ ("running") }) }, failure);
  };

  const order = h("select", null, (settingOf("shot", "order").choices ?? []).map(({ name, label }) => h("option", { value: name }, label)));
  order.addEventListener("change", () => void change(job(), { order: order.value }, t("The order could not be changed")));
  const orderField = field(t("Order"), order);

  const failedText = h("span");
  const again = h(
    "button",
    { class: "button wide", type: "button", onclick: () => void change(job(), { state: "running" }, t("The frames could not be retried")) },
    icon("refresh"),
    failedText,
  );

  const extend = framesInput();
  const extendForm = smallForm(t("More frames"), extend, t("Add"), async () => {
    await apply({ extend: extend.value }, t("The shot was not extended"));
    extend.value = "";
  });

  const part = framesInput();
  const more = numberInput({ value: MORE, min: 1, max: 1e6, label: t("Samples") });
  const partForm = smallForm(t("More samples for frames"), part, t("Add"), () =>
    apply({ frames: part.value, more: numberOf(more, MORE) }, t("No samples were added")),
  );
  part.after(more);
  const anew = h(
    "button",
    {
      class: "text-button small",
      type: "button",
      title: t("From the first sample, for example after a change of the scene's files"),
      onclick: () => part.reportValidity() && void apply({ again: part.value }, t("The frames could not be rendered again")),
    },
    t("Render these again"),
  );
  partForm.append(anew);

  let typed = false;
  part.addEventListener("input", () => (typed = part.value !== ""));
  const suggest = () => {
    if (!typed) part.value = frames.range.value ? partText(frames) : String(frames.current.value);
    part.dispatchEvent(new Event("check"));
  };
  life.add(frames.range.subscribe(suggest));
  life.add(frames.current.subscribe(suggest));

  const update = () => {
    const { shot, state } = job();
    if (!shot) return;
    if (document.activeElement !== order) order.value = shot.order;
    orderField.hidden = state === "finished";
    again.hidden = !shot.failed || !["finished", "failed"].includes(state);
    setText(failedText, tn(shot.states.failed ?? 0, "Try {n} failed frame again", "Try {n} failed frames again"));
  };
  update();
  const element = h(
    "details",
    { class: "side-section shot-edit" },
    h("summary", null, t("Change the shot")),
    h("div", { class: "stack" }, orderField, extendForm, partForm),
  );
  return { element: h("div", { class: "shot-changes for-submit" }, h("div", { class: "again-box" }, again), element), update };
}

function framesInput() {
  const input = h("input", { type: "text", autocomplete: "off", spellcheck: "false", required: true, placeholder: "100-149" });
  const check = () => {
    const found = parseFrames(input.value || "0");
    input.setCustomValidity(typeof found === "string" ? found : "");
  };
  input.addEventListener("input", check);
  input.addEventListener("check", check);
  return input;
}

/**
 * @param {string} label
 * @param {HTMLInputElement} input
 * @param {string} verb
 * @param {() => Promise<void>} run
 */
function smallForm(label, input, verb, run) {
  const element = field(label, input);
  explain(element, label, [input]);
  const button = h("button", { class: "button", type: "submit" }, verb);
  const line = h("div", { class: "edit-line" });
  input.before(line);
  line.append(input, button);
  const onsubmit = async (/** @type {SubmitEvent} */ event) => {
    event.preventDefault();
    if (!form.checkValidity()) return;
    button.disabled = true;
    await run();
    button.disabled = false;
  };
  const form = h("form", { noValidate: true, onsubmit, "aria-label": label }, element);
  return form;
}
