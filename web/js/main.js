/** Starts the page: the shell, the farm's events, drops, and the views. */

import { fill } from "./base/dom.js";
import { chooseProject, chosenProject } from "./base/project.js";
import { followFarm, lost } from "./news/farm.js";
import { loadProjects, offer } from "./news/projects.js";
import { may, mustLogIn, session } from "./news/session.js";
import { followTallies } from "./news/job-list.js";
import { UPLOAD_LIKELY, acceptDrops } from "./shell/drops.js";
import { showHelp } from "./shell/help-dialog.js";
import { isOutdated } from "./shell/missing-view.js";
import { notifyOfEndedJobs } from "./shell/notify.js";
import { followFrame } from "./shell/layouts.js";
import { PALETTE_KEYS, listenForPalette, showPalette } from "./shell/palette.js";
import { here } from "./shell/router.js";
import { followScroll } from "./shell/scroll-memory.js";
import { buildShell } from "./shell/shell.js";
import { addShortcuts } from "./shell/shortcuts.js";
import { showActionNotice, showError, undoLast } from "./shell/tray.js";
import { loginView, takeCode } from "./views/login.js";
import { NAV, loadSceneView, showViews } from "./views/showing.js";
import { t } from "./base/words.js";

const main = /** @type {HTMLElement} */ (document.getElementById("main"));

function start() {
  offer(document.documentElement, chosenProject());
  document.documentElement.classList.toggle("is-admin", may("admin"));
  const markSection = buildShell(NAV);
  followFrame();
  followScroll();
  showViews(main, markSection);
  addShortcuts([
    { keys: "?", does: t("This help"), run: showHelp },
    { keys: PALETTE_KEYS, does: t("Find scenes, jobs, actions"), run: () => showPalette(NAV) },
    { keys: "Z", does: t("Undo the last deletion or change"), run: undoLast },
  ]);
  listenForPalette(NAV);
  acceptDrops();
  addEventListener(UPLOAD_LIKELY, prepareScene);
  followFarm();
  followTallies();
  notifyOfEndedJobs();
  // A revoked session closes all connections without a reason, so the session is checked then.
  lost.subscribe(({ size }) => size && void mustLogIn().then((must) => must && location.reload()));
  showUpdateNotices();
}

/** Loads what shows a scene, then compiles what draws its preview: that blocks the page, which shows the scene's view first. */
async function prepareScene() {
  try {
    await loadSceneView();
    const { warmMesh } = await import("./scene/mesh-relay.js");
    warmMesh();
  } catch (error) {
    console.warn(error); // the scene's view reports it
  }
}

/** Offers a reload if the service has another version of the page after a reconnection. */
function showUpdateNotices() {
  let wasLost = false;
  let isTold = false;
  lost.subscribe(async ({ size }) => {
    const isBack = wasLost && !size;
    wasLost = size > 0;
    if (!isBack || isTold || !(await isOutdated())) return;
    isTold = true;
    showActionNotice(t("Rayfarm was updated"), { label: t("Reload the page"), run: () => location.reload() });
  });
}

/** @param {unknown} error */
const fault = (error) =>
  showError(t("An error occurred on this page"), error, { action: { label: t("Reload the page"), run: () => location.reload() } });
addEventListener("error", (event) => event.error && fault(event.error));
addEventListener("unhandledrejection", (event) => fault(event.reason));

// A login link opened in a tab that already shows this page only changes the hash.
addEventListener("hashchange", () => here().path[0] === "login" && location.reload());
const code = takeCode();
const must = await mustLogIn();
if (code !== null || must) {
  /** @type {HTMLElement} */ (document.getElementById("topbar")).hidden = true;
  /** @type {any} */ (window).rayfarmAgain.viewShown();
  fill(main, loginView(code).element);
} else {
  if (session.value.login) await loadProjects();
  else chooseProject(null); // without logins, items belong to all
  start();
}
