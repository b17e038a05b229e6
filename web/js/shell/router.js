/**
 * The location in the URL's hash: `#/jobs/ab12?ev=1.5&tone=agx`. The path names the view and the parameters its state, so that a
 * link, the back button and a reload restore the same picture.
 */

/**
 * @typedef {object} Place
 * @property {string[]} path e.g. ["jobs", "ab12"]; [] is the front page
 * @property {URLSearchParams} params
 */

/** @returns {Place} */
export function here() {
  const [path = "", query = ""] = location.hash.replace(/^#/, "").split("?", 2);
  return { path: path.split("/").filter(Boolean).map(decoded), params: new URLSearchParams(query) };
}

/** Decodes a part of the path; a malformed one is returned unchanged. @param {string} part */
function decoded(part) {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

/**
 * @param {...string} path
 * @returns {string} a hash for a link
 */
export function linkTo(...path) {
  return `#/${path.map(encodeURIComponent).join("/")}`;
}

/** @param {...string} path */
export function go(...path) {
  location.hash = linkTo(...path);
}

/**
 * Makes a link to another view of a shot keep the current frame.
 *
 * @param {Event} event its click
 * @param {number | string | null} frame null: none, or the first
 */
export function followWithFrame(event, frame) {
  const anchor = /** @type {HTMLAnchorElement} */ (event.currentTarget);
  const [path = ""] = anchor.hash.split("?", 1);
  anchor.href = frame === null ? path : `${path}?frame=${frame}`;
}

/**
 * Writes view state into the URL without a history entry or navigation. Null removes a parameter.
 *
 * @param {Record<string, string | null>} changes
 * @param {string[]} [path] where the view's own choice is a part of it
 */
export function setParams(changes, path = here().path) {
  const { params } = here();
  for (const [name, value] of Object.entries(changes)) {
    if (value === null) params.delete(name);
    else params.set(name, value);
  }
  const query = params.toString();
  history.replaceState(history.state, "", linkTo(...path) + (query ? `?${query}` : ""));
}

/**
 * Notifies a view of a changed state in the URL: by a link, the back button, or editing the address.
 *
 * @param {() => void} listener
 * @returns {() => void} ends it
 */
export function onParams(listener) {
  const { path } = here();
  const check = () => here().path.join("/") === path.join("/") && listener();
  addEventListener("hashchange", check);
  return () => removeEventListener("hashchange", check);
}

/** @param {string} [title] of the open view; empty for the front page */
export function setTitle(title) {
  document.title = title ? `${title} – Rayfarm` : "Rayfarm";
}

/** @param {(place: Place) => void} listener called now and whenever the path changes */
export function onNavigate(listener) {
  /** @type {string | null} */
  let shown = null;
  const check = () => {
    const place = here();
    const path = place.path.join("/");
    if (path === shown) return;
    shown = path;
    listener(place);
  };
  addEventListener("hashchange", check);
  check();
}
