/** The user's projects and permissions in them, if the farm requires a login. */

import { getAll } from "./api.js";
import { may, session } from "./session.js";
import { chooseProject, chosenProject } from "../base/project.js";
import { Store } from "../base/store.js";
import { t } from "../base/words.js";

/** Names of the visible projects, sorted. @type {Store<string[]>} */
export const projects = new Store(/** @type {string[]} */ ([]));

/** Projects that the user may only view. @type {Set<string>} */
const readOnlyProjects = new Set();

/** Loads the projects; a selected project that no longer exists is deselected. */
export async function loadProjects() {
  const { name: me } = session.value;
  try {
    const found = /** @type {{name: string, roles?: Record<string, string>}[]} */ (await getAll("/projects"));
    readOnlyProjects.clear();
    for (const { name, roles } of found) if (!may("admin") && roles?.[me ?? ""] === "view") readOnlyProjects.add(name);
    projects.set(found.map(({ name }) => name));
  } catch {
    return; // the banner shows that the service does not respond
  }
  if (!projects.value.includes(chosenProject() ?? "")) chooseProject(null);
}

/** @param {string | null | undefined} project of the content; empty: none @returns {boolean} whether the user may add and change content there */
export const mayChange = (project) => may("submit") && !readOnlyProjects.has(project ?? "");

/** @param {string | null | undefined} project that the user may not change @returns {string} the reason, as a sentence */
export const readOnlyReason = (project) =>
  may("submit")
    ? t("You can view project {name}, but not change it. Ask the administrator of this farm.", { name: project ?? "" })
    : t("Your role allows viewing, but not rendering. Ask the administrator of this farm.");

/**
 * Disables or hides the controls in a part of the page that the project's permissions would refuse.
 * @param {HTMLElement} part
 * @param {string | null | undefined} project
 */
export function offer(part, project) {
  part.dataset.may = mayChange(project) ? "submit" : "view";
}
