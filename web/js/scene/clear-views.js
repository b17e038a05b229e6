/** The last clear pictures of live views, kept for this tab: shown at once when the same view is opened again, until it is as clear. */

const KEY = "rayfarm-clear-views";
/** Number of pictures that are kept. */
const MOST = 8;

/** @typedef {{scene: string, request: string, url: string}} ClearView request: of the view, as JSON; url: of the picture, `data:` */

/** @returns {ClearView[]} the newest first */
function kept() {
  try {
    const found = JSON.parse(sessionStorage.getItem(KEY) ?? "[]");
    return Array.isArray(found) ? found : [];
  } catch {
    return []; // a browser that keeps nothing, or a damaged entry
  }
}

/** Returns the picture of a view; "" if there is none. @param {string} scene @param {string} request */
export function clearView(scene, request) {
  return kept().find((view) => view.scene === scene && view.request === request)?.url ?? "";
}

/** @param {string} scene @param {string} request @param {string} url */
export function keepClearView(scene, request, url) {
  const others = kept().filter((view) => view.scene !== scene || view.request !== request);
  for (let most = MOST - 1; most >= 0; most--) {
    try {
      sessionStorage.setItem(KEY, JSON.stringify([{ scene, request, url }, ...others.slice(0, most)]));
      return;
    } catch {
      // It is full: fewer pictures are kept.
    }
  }
}
