/**
 * Where the user is, kept in the URL's hash: `#/jobs/ab12?ev=1.5&tone=agx`. The path names the view and the parameters its
 * state, so that a link, the back button and a reload all give the same picture.
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

/** A part of the path as it was meant; one that somebody has cut in the middle of a character stays as it is. @param {string} part */
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
 * A link to another view of a shot goes on with the frame that is looked at now.
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
 * Writes view state into the URL without a history entry, and without a navigation. Null takes a parameter out.
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
 * Tells a view that another state of it is asked for: by a link, the back button, or a hand in the address.
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

/** @param {string} [title] of the view that is open; the front page has none of its own */
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
