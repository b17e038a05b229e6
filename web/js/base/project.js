/** The project that this browser works in: what is uploaded goes there, and lists show what is in it. Null: all that one sees. */

const KEY = "rayfarm-project";

/** @returns {string | null} */
export function chosenProject() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // a browser that keeps nothing
  }
}

/** @param {string | null} name */
export function chooseProject(name) {
  try {
    if (name === null) localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, name);
  } catch {
    // As above: then it is all that one sees.
  }
}

/** @param {string} path of the API, with or without a query @returns {string} the same within the project */
export function inProject(path) {
  const name = chosenProject();
  return name === null ? path : `${path}${path.includes("?") ? "&" : "?"}project=${encodeURIComponent(name)}`;
}

/** Whether what is told of belongs to what the page shows. @param {{project?: string, deleted?: boolean}} item */
export function isShown(item) {
  const name = chosenProject();
  return name === null || item.deleted === true || (item.project ?? "") === name;
}
