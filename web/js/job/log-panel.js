/** The log of a picture or of one of its tiles, from the service and the workers. */

import { getJobLog, getTileLog, jobLogUrl } from "../news/api.js";
import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { announce, showError } from "../shell/tray.js";
import { withFold } from "../shell/layouts.js";
import { t } from "../base/words.js";

const RENEW_MS = 2000;

/**
 * @param {() => import("../base/types.js").Job} job
 * @param {import("../base/store.js").Disposer} life
 */
export function logPanel(job, life) {
  /** The tile as its frame and a pixel in it; null: the whole job. @type {{frame: number, x: number, y: number} | null} */
  let tile = null;
  let isCalled = false; // Whether to scroll it into view once it is loaded.
  const whole = h("button", { class: "text-button small", type: "button", onclick: () => show(null) }, t("The whole log"));
  const which = h("p", { class: "row spread small", hidden: true }, h("span"), whole);
  const lines = h("pre", { class: "log-lines", tabindex: "0", role: "log", "aria-live": "off", "aria-label": t("Log") });
  const follow = h("input", { type: "checkbox", onchange: () => follow.checked && toEnd() });
  follow.checked = true;
  const copy = h("button", { class: "icon-button", type: "button", "aria-label": t("Copy the log"), title: t("Copy the log"), onclick: () => void copied() }, icon("copy"));
  const { id, name } = job();
  const save = h("a", { class: "icon-button", href: jobLogUrl(id), download: `${name}.log`, "aria-label": t("Download the log"), title: t("Download the log") }, icon("download"));
  const said = h("p", { class: "quiet small", role: "status", hidden: true });
  const element = withFold("log", h(
    "details",
    { class: "side-section job-log" },
    h("summary", null, h("h2", null, t("Log"))),
    h("div", { class: "stack tight" }, h("div", { class: "row" }, h("label", { class: "check grow" }, follow, t("Follow")), copy, save), which, said, lines),
  ));
  const toEnd = () => (lines.scrollTop = lines.scrollHeight);
  const copied = async () => {
    try {
      await navigator.clipboard.writeText(lines.textContent ?? "");
      announce(t("The log is copied"));
    } catch (error) {
      showError(t("The log was not copied"), navigator.clipboard ? error : t("Browsers copy from pages on HTTPS and localhost only."));
    }
  };
  let asking = new AbortController();
  life.add(() => asking.abort());
  const renew = async () => {
    asking.abort();
    const { signal } = (asking = new AbortController());
    try {
      const text = tile ? await getTileLog({ job: id, frame: tile.frame }, tile, signal) : await getJobLog(id, signal);
      if (text !== lines.textContent) {
        setText(lines, text);
        if (follow.checked) toEnd();
      }
      if (isCalled) element.scrollIntoView({ block: "nearest" });
      isCalled = false;
      said.hidden = text !== "";
      if (!text) setText(said, t("No lines yet. They appear when a worker starts."));
    } catch (error) {
      if (signal.aborted) return;
      said.hidden = false;
      setText(said, /** @type {Error} */ (error).message);
    }
  };
  const show = (/** @type {typeof tile} */ of) => {
    tile = of;
    which.hidden = !of;
    if (of) setText(/** @type {HTMLElement} */ (which.firstChild), t("Tile with {x}, {y}", { x: of.x, y: of.y }));
    setText(lines, "");
    void renew();
  };
  // Scrolling up stops following the log; scrolling to the end resumes it.
  lines.addEventListener("scroll", () => (follow.checked = lines.scrollHeight - lines.scrollTop - lines.clientHeight < 8));
  element.addEventListener("toggle", () => element.open && void renew());
  life.every(RENEW_MS, () => element.open && !document.hidden && void renew());
  return {
    element,
    /** Shows the log of the tile that contains a pixel. @param {number} frame @param {{x: number, y: number}} pixel */
    ofTile(frame, { x, y }) {
      element.open = true;
      isCalled = true;
      show({ frame, x, y });
    },
  };
}
