/** The top bar, the banners "connection lost" and "server busy", and the container of the view. */

import { fill, h, setText } from "../base/dom.js";
import { retries } from "../news/busy.js";
import { lost, workers } from "../news/farm.js";
import { showHelp } from "./help-dialog.js";
import { icon } from "../base/icons.js";
import { tallies } from "../news/job-list.js";
import { session } from "../news/session.js";
import { notifyButton } from "./notify.js";
import { languageMenu } from "./language-menu.js";
import { showPalette } from "./palette.js";
import { projectMenu } from "./project-menu.js";
import { linkTo } from "./router.js";
import { themeButton } from "./theme-button.js";
import { announce } from "./tray.js";
import { t, tn } from "../base/words.js";

/** Shorter interruptions are not shown. */
const LOST_AFTER_MS = 1500;

/** Relative to the modules, so with the same version in the URL. */
const ICON = new URL("../../icon.svg", import.meta.url).href;

/**
 * Builds the top bar.
 *
 * @param {readonly (readonly [string, string])[]} nav its links: label, section
 * @returns {(section: string) => void} marks the section that is open
 */
export function buildShell(nav) {
  const bar = /** @type {HTMLElement} */ (document.getElementById("topbar"));
  const main = /** @type {HTMLElement} */ (document.getElementById("main"));
  const links = nav.map(([label, path]) => ({ path, tally: h("span", { class: "tally", hidden: true }), label })).map(
    ({ path, tally, label }) => ({
      path,
      tally,
      element: h("a", { href: path ? linkTo(path) : linkTo() }, label, tally),
    }),
  );
  // Part of the bar where it has room, else what the button "More" opens.
  const more = h(
    "div",
    { class: "topbar-more", id: "topbar-more", popover: "auto" },
    h("button", { class: "icon-button help-button", type: "button", "aria-label": t("Help"), title: t("Help (?)"), onclick: showHelp }, "?"),
    accountLink(),
    notifyButton(),
    languageMenu(),
    themeButton(),
  );
  fill(
    bar,
    h("button", { class: "button skip", type: "button", onclick: () => main.focus() }, t("Skip to the content")),
    h(
      "a",
      { class: "brand", href: linkTo(), "aria-label": t("Rayfarm, front page") },
      h("img", { src: ICON, alt: "" }),
      h("span", null, "Rayfarm"),
    ),
    h(
      "nav",
      { "aria-label": t("Sections") },
      links.map(({ element }) => element),
    ),
    h(
      "button",
      { class: "icon-button find-button", type: "button", "aria-label": t("Find"), title: t("Find (Ctrl+K)"), onclick: () => showPalette(nav) },
      icon("search"),
    ),
    projectMenu(),
    h("button", { class: "icon-button more-button", type: "button", "aria-label": t("More"), title: t("More"), popovertarget: "topbar-more" }, icon("more")),
    more,
  );

  /** @param {string} section @param {number} n @param {string} label @param {boolean} [alarm] */
  const setTally = (section, n, label, alarm = false) => {
    const found = links.find(({ path }) => path === section);
    if (!found) return;
    setText(found.tally, n);
    found.tally.hidden = n === 0 && !alarm;
    found.tally.classList.toggle("none", alarm);
    found.tally.title = label;
  };
  tallies.subscribe((all) => {
    const running = (all?.running ?? 0) + (all?.queued ?? 0);
    setTally("jobs", running, t("{n} running", { n: running }));
  });
  workers.subscribe((all) =>
    setTally("workers", all?.length ?? 0, all?.length ? t("{slots} on {workers}", countsOf(all)) : t("No worker is connected"), all?.length === 0),
  );
  buildLostBanner();
  buildBusyBanner();
  return (section) => {
    more.togglePopover(false); // a link in it does not close it
    for (const { path, element } of links) {
      if (path === section) element.setAttribute("aria-current", "page");
      else element.removeAttribute("aria-current");
    }
  };
}

/** @param {import("../base/types.js").Worker[]} all */
const countsOf = (all) => ({
  slots: tn(all.reduce((sum, { slots }) => sum + slots, 0), "{n} slot", "{n} slots"),
  workers: tn(all.length, "{n} worker", "{n} workers"),
});

function buildLostBanner() {
  const banner = h(
    "div",
    { class: "lost-banner", role: "status", hidden: true },
    icon("warning"),
    t("Connection lost. Trying again …"),
  );
  document.body.append(banner);
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  lost.subscribe(({ size }) => {
    if (size) {
      timer ??= setTimeout(() => (banner.hidden = false), LOST_AFTER_MS);
      document.body.classList.add("is-lost");
      return;
    }
    document.body.classList.remove("is-lost");
    clearTimeout(timer);
    timer = undefined;
    if (!banner.hidden) announce(t("Connected again"));
    banner.hidden = true;
  });
}

/** The banner for a busy service, with the time of the next retry. */
export function buildBusyBanner() {
  const words = h("span");
  const banner = h("div", { class: "lost-banner busy", role: "status", hidden: true }, icon("warning"), words);
  document.body.append(banner);
  /** @type {ReturnType<typeof setInterval> | undefined} */
  let timer;
  const show = () => {
    const seconds = Math.max(1, Math.ceil((Math.min(...retries.value) - performance.now()) / 1000));
    setText(words, t("Server busy, retrying in {n} s", { n: seconds }));
  };
  retries.subscribe(({ length }) => {
    banner.hidden = !length;
    clearInterval(timer);
    timer = length ? setInterval(show, 1000) : undefined;
    if (length) show();
  });
}

/** A link with the user's name to the account page, if logged in. */
function accountLink() {
  const { login, name } = session.value;
  if (!login || name === null) return null;
  return h("a", { class: "icon-button account-link", href: linkTo("account"), title: t("Logged in as {name}", { name }), "aria-label": t("Logged in as {name}", { name }) }, icon("person"));
}
