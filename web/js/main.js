/** Starts the page: the shell, the farm's news, drops, and the view that the URL names. */

import { fill, h } from "./base/dom.js";
import { chooseProject, chosenProject } from "./base/project.js";
import { followFarm, lost } from "./news/farm.js";
import { lookAtProjects, offer } from "./news/projects.js";
import { may, mustLogIn, session } from "./news/session.js";
import { followTallies } from "./news/job-list.js";
import { showHelp } from "./shell/help-dialog.js";
import { emptyPage } from "./shell/hints.js";
import { tellOfEnds } from "./shell/notify.js";
import { here, linkTo, onNavigate } from "./shell/router.js";
import { followScroll, scrollToPlace } from "./shell/scroll-memory.js";
import { buildShell } from "./shell/shell.js";
import { addShortcuts } from "./shell/shortcuts.js";
import { clearPageErrors, showError, undoLast } from "./shell/tray.js";
import { acceptDrops } from "./shell/uploads.js";
import { accountView } from "./views/account.js";
import { compareView } from "./views/compare.js";
import { homeView } from "./views/home.js";
import { jobView } from "./views/job.js";
import { jobsView } from "./views/jobs.js";
import { sceneView } from "./views/scene.js";
import { loginView, takeCode } from "./views/login.js";
import { workersView } from "./views/workers.js";
import { t } from "./base/words.js";

/** @typedef {{element: HTMLElement, dispose: () => void}} View */

/** The section that a view belongs to, where it is not called so. @type {Record<string, string>} */
const SECTION_OF = { scenes: "", compare: "jobs" };

/**
 * @param {string[]} path
 * @returns {View}
 */
function viewFor([section, id, other]) {
  if (!section) return homeView();
  if (section === "scenes" && id) return sceneView(id);
  if (section === "jobs") return id ? jobView(id) : jobsView();
  if (section === "compare" && id) return compareView(id, other);
  if (section === "workers") return workersView();
  if (section === "account") return accountView();
  const element = h(
    "div",
    { class: "page" },
    emptyPage("info", t("There is nothing at this address"), h("a", { href: linkTo() }, t("To the front page"))),
  );
  return { element, dispose: () => {} };
}

const main = /** @type {HTMLElement} */ (document.getElementById("main"));

function start() {
  offer(document.documentElement, chosenProject());
  document.documentElement.classList.toggle("is-admin", may("admin"));
  const markSection = buildShell();
  /** @type {View | null} */
  let shown = null;

  followScroll();
  onNavigate(({ path }) => {
    const first = shown === null;
    shown?.dispose();
    clearPageErrors();
    shown = viewFor(path);
    fill(main, shown.element);
    markSection(SECTION_OF[path[0] ?? ""] ?? path[0] ?? "");
    scrollToPlace();
    // A screen reader starts to read the new view; at the start the browser's own focus stays.
    if (!first) main.focus({ preventScroll: true });
  });

  addShortcuts([
    { keys: "?", does: t("This help"), run: showHelp },
    { keys: "Z", does: t("Undo the last deletion or change"), run: undoLast },
  ]);
  acceptDrops();
  followFarm();
  followTallies();
  tellOfEnds();
  // Who was logged out meanwhile loses all connections, and is not told why by any of them.
  lost.subscribe(({ size }) => size && void mustLogIn().then((must) => must && location.reload()));
}

/** @param {unknown} error */
const fault = (error) =>
  showError(t("The page has a fault"), error, { action: { label: t("Reload the page"), run: () => location.reload() } });
addEventListener("error", (event) => event.error && fault(event.error));
addEventListener("unhandledrejection", (event) => fault(event.reason));

// A link that lets in, opened in a tab that shows this page already, changes the address alone.
addEventListener("hashchange", () => here().path[0] === "login" && location.reload());
const code = takeCode();
const must = await mustLogIn();
if (code !== null || must) {
  /** @type {HTMLElement} */ (document.getElementById("topbar")).hidden = true;
  fill(main, loginView(code).element);
} else {
  if (session.value.login) await lookAtProjects();
  else chooseProject(null); // where nobody is asked who they are, all is everybody's
  start();
}
