/** The project selected in this browser: uploads go into it, and lists show only its items. Null: all visible items. */

const KEY = "rayfarm-project";

/** @returns {string | null} */
export function chosenProject() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // storage is blocked
  }
}

/** @param {string | null} name */
export function chooseProject(name) {
  try {
    if (name === null) localStorage.removeItem(KEY);
    else localStorage.setItem(KEY, name);
  } catch {
    // Storage is blocked: no project is selected.
  }
}

/** @param {string} path of the API, with or without a query @returns {string} the same restricted to the project */
export function inProject(path) {
  const name = chosenProject();
  return name === null ? path : `${path}${path.includes("?") ? "&" : "?"}project=${encodeURIComponent(name)}`;
}

/** Whether an item of an event belongs to the selected project. @param {{project?: string, deleted?: boolean}} item */
export function isShown(item) {
  const name = chosenProject();
  return name === null || item.deleted === true || (item.project ?? "") === name;
}
