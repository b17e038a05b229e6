/** The field of jobs that a new one waits for; a click removes one. */

import { fill, h } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { hidden, jobs } from "../news/farm.js";
import { field } from "./fields.js";

const OPEN = ["queued", "running", "paused"];
const MOST = 100;

/** @param {() => void} changed by the user @returns {{element: HTMLElement, get: () => string[], dispose: () => void}} */
export function afterField(changed) {
  /** @type {Map<string, string>} */
  const chosen = new Map();
  const select = h("select");
  const list = h("ul", { class: "chosen", "aria-label": t("Depends on"), hidden: true });
  const element = field(t("After"), select, t("Starts when they are finished. If one fails, this job fails too."));
  select.after(list);
  let shown = "";
  const show = () => {
    const open = (jobs.value ?? []).filter(({ id, state }) => OPEN.includes(state) && !hidden.value.has(id));
    const free = open.filter(({ id }) => !chosen.has(id)).slice(0, MOST);
    const key = JSON.stringify([free.map(({ id }) => id), [...chosen.keys()]]);
    if (key === shown) return;
    shown = key;
    const none = free.length === 0 ? t("no other unfinished job") : t("another job");
    fill(
      select,
      h("option", { value: "" }, chosen.size ? none : open.length ? t("no other job") : t("no unfinished jobs")),
      free.map(({ id, name, state, progress }) => h("option", { value: id }, state === "running" ? `${name} · ${Math.floor(progress * 100)} %` : name)),
    );
    select.disabled = free.length === 0;
    list.hidden = chosen.size === 0;
    fill(list, [...chosen].map(([id, name]) => h("li", null, h("span", { title: name }, name), leave(id, name))));
  };
  /** @param {string} id @param {string} name */
  const leave = (id, name) =>
    h(
      "button",
      {
        class: "icon-button",
        type: "button",
        "aria-label": t("Do not wait for {name}", { name }),
        title: t("Do not wait for {name}", { name }),
        onclick: () => {
          chosen.delete(id);
          show();
          changed();
          select.focus();
        },
      },
      icon("close"),
    );
  select.addEventListener("change", () => {
    const job = jobs.value?.find(({ id }) => id === select.value);
    if (job) chosen.set(job.id, job.name);
    show();
    changed();
  });
  const ends = [jobs.subscribe(show), hidden.subscribe(show)];
  return { element, get: () => [...chosen.keys()], dispose: () => ends.forEach((end) => void end()) };
}
