/** Optional notifications about finished jobs while the page is hidden. */

import { fill, h } from "../base/dom.js";
import { jobs } from "../news/farm.js";
import { icon } from "../base/icons.js";
import { linkTo } from "./router.js";
import { announce, showError } from "./tray.js";
import { saidOf } from "../base/said.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

const KEY = "rayfarm.notify";
/** Jobs that end together are reported together. */
const GATHER_MS = 1000;
/** @type {Record<string, string>} */
const ENDS = { finished: t("finished"), failed: t("failed") };
const UNDER_WAY = ["queued", "running", "paused"];

function isWanted() {
  try {
    return localStorage.getItem(KEY) === "on" && Notification.permission === "granted";
  } catch {
    return false; // storage is blocked
  }
}

/** @param {boolean} wanted */
function keep(wanted) {
  try {
    localStorage.setItem(KEY, wanted ? "on" : "off");
  } catch {
    // Storage is blocked: the choice cannot be stored.
  }
}

/** The button that enables and disables notifications. Hidden if the browser has none, as on plain HTTP. */
export function notifyButton() {
  const button = h("button", { class: "icon-button notify", type: "button", "aria-label": t("Notify me when a job ends") });
  button.hidden = !("Notification" in window) || !isSecureContext;
  const show = () => {
    const on = !button.hidden && isWanted();
    fill(button, icon(on ? "bell" : "bellOff"));
    button.setAttribute("aria-pressed", String(on));
    button.title = on ? t("A notification comes when a job ends") : t("Notify me when a job ends");
  };
  button.addEventListener("click", async () => {
    if (isWanted()) keep(false);
    else if ((await Notification.requestPermission()) === "granted") keep(true);
    else
      showError(t("There will be no notifications"), t("The browser does not allow them for this page."), {
        remedy: t("Allow notifications beside the address bar, then press the bell again."),
      });
    show();
    announce(button.title);
  });
  show();
  return button;
}

/** Watches the jobs and notifies about those that end. */
export function notifyOfEndedJobs() {
  /** @type {Map<string, string>} */
  const before = new Map();
  /** @type {Job[]} */
  let ended = [];
  const tell = () => {
    const [first, ...others] = ended;
    ended = [];
    if (!first || !isWanted() || (document.visibilityState === "visible" && document.hasFocus())) return;
    const title = others.length ? tn(others.length + 1, "{n} job ended", "{n} jobs ended") : `${first.name}: ${ENDS[first.state] ?? first.state}`;
    const body = others.length ? [first, ...others].map(({ name, state }) => `${name}: ${ENDS[state] ?? state}`).slice(0, 4).join("\n") : saidOf(first, "error");
    const notification = new Notification(title, { body, tag: first.id });
    notification.onclick = () => {
      focus();
      location.hash = others.length ? linkTo("jobs") : linkTo("jobs", first.id);
      notification.close();
    };
  };
  jobs.subscribe((all) => {
    for (const job of all ?? []) {
      const wasUnderWay = UNDER_WAY.includes(before.get(job.id) ?? "");
      before.set(job.id, job.state);
      if (!wasUnderWay || (job.state !== "finished" && job.state !== "failed")) continue;
      if (ended.length === 0) setTimeout(tell, GATHER_MS);
      ended.push(job);
    }
  });
}
