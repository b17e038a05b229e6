/** Shows the view that the URL names. A view's modules are loaded when it is first opened, or preloaded (../shell/ahead.js). */

import { fill, h } from "../base/dom.js";
import { emptyPage } from "../shell/hints.js";
import { meantPath } from "../shell/meant-path.js";
import { missingView } from "../shell/missing-view.js";
import { linkTo, onNavigate } from "../shell/router.js";
import { scrollToPlace } from "../shell/scroll-memory.js";
import { clearPageErrors } from "../shell/tray.js";
import { t } from "../base/words.js";

/** @typedef {{element: HTMLElement, dispose: () => void}} View */
/** @typedef {(...ids: string[]) => View} MakeView of what the address names behind the section */

/**
 * The views by their addresses: a section, and ID for what follows it. The service reads this table too (service/page_index.py),
 * so that ../shell/ahead.js can request a view's modules early.
 *
 * @type {Record<string, () => Promise<MakeView>>}
 */
const VIEWS = {
  "": async () => (await import("./home.js")).homeView,
  "account": async () => (await import("./account.js")).accountView,
  "compare/ID": async () => (await import("./compare.js")).compareView,
  "jobs": async () => (await import("./jobs.js")).jobsView,
  "jobs/ID": async () => (await import("./job.js")).jobView,
  "scenes/ID": async () => (await import("./scene.js")).sceneView,
  "workers": async () => (await import("./workers.js")).workersView,
};

/** The links of the top bar: label, section. */
export const NAV = /** @type {const} */ ([
  [t("Scenes"), ""],
  [t("Jobs"), "jobs"],
  [t("Workers"), "workers"],
]);

/** The section of NAV that another section belongs to. @type {Record<string, string>} */
const SECTION_OF = { scenes: "", compare: "jobs" };

/** @type {{viewAt: (hash: string) => string | null, viewShown: () => Promise<boolean>}} */
const ahead = /** @type {any} */ (window).rayfarmViews;
/** @type {{loadAgain: () => boolean, viewShown: () => void}} */
const again = /** @type {any} */ (window).rayfarmAgain;

/** Loads the modules of a scene's view, which is likely to be opened soon. */
export const loadSceneView = () => VIEWS["scenes/ID"]?.();

/** Preloads the other views; starts the modules of a scene's view, which take longest, once the page has nothing else to do. */
async function loadWhenIdle() {
  if (!(await ahead.viewShown())) return;
  const whenIdle = window.requestIdleCallback ?? setTimeout; // Safari has only the latter
  whenIdle(() => void loadSceneView()?.catch(() => {})); // the view reports it when it is opened
}

/** @type {MakeView} */
function nothingHere() {
  const link = h("a", { href: linkTo() }, t("To the front page"));
  return { element: h("div", { class: "page" }, emptyPage("info", t("There is nothing at this address"), link)), dispose: () => {} };
}

/**
 * Starts showing views.
 *
 * @param {HTMLElement} main where it is shown
 * @param {(section: string) => void} markSection
 */
export function showViews(main, markSection) {
  /** Loaded views by address; null where there is none. @type {Map<string | null, MakeView>} */
  const here = new Map([[null, nothingHere]]);
  /** @type {View | null} */
  let shown = null;
  let isFirst = true;
  let visit = 0;

  /** @param {View} view */
  const show = (view) => {
    shown = view;
    main.inert = false;
    main.removeAttribute("aria-busy");
    fill(main, view.element);
    scrollToPlace();
    // Screen readers then read the new view; at the start the browser's own focus stays.
    if (!isFirst) return main.focus({ preventScroll: true });
    isFirst = false;
    again.viewShown();
    void loadWhenIdle();
  };

  /** @param {string} address @returns {Promise<MakeView | null>} null: the page will be loaded again */
  const fetched = async (address) => {
    try {
      const make = (await VIEWS[address]?.()) ?? nothingHere;
      here.set(address, make);
      return make;
    } catch (error) {
      console.error(error); // the error may also be in the module
      return isFirst && again.loadAgain() ? null : missingView;
    }
  };

  onNavigate(async ({ path }) => {
    const [section = "", ...ids] = path;
    const address = ahead.viewAt(location.hash);
    const meant = address === null ? meantPath(path, (other) => ahead.viewAt(linkTo(...other)) !== null) : null;
    if (meant) return location.replace(linkTo(...meant)); // the back button leads past the mistaken address
    visit += 1;
    const mine = visit;
    clearPageErrors();
    markSection(SECTION_OF[section] ?? section);
    let make = here.get(address) ?? null;
    if (!make && address !== null) {
      // The previous view stays visible meanwhile, but inactive. It is disposed of afterwards, since that clears its canvas.
      main.inert = !isFirst;
      main.setAttribute("aria-busy", "true");
      make = await fetched(address);
    }
    if (!make || mine !== visit) return;
    shown?.dispose();
    shown = null;
    show(make(...ids));
  });
}
