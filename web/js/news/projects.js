/** Which project the page works in, where the farm asks for a login and one is a member of some; and what one may do there. */

import { getAll } from "./api.js";
import { may, session } from "./session.js";
import { chooseProject, chosenProject } from "../base/project.js";
import { Store } from "../base/store.js";
import { t } from "../base/words.js";

/** Those that one sees, by name. @type {Store<string[]>} */
export const projects = new Store(/** @type {string[]} */ ([]));

/** Those in which one may look at everything and change nothing. @type {Set<string>} */
const onlySeen = new Set();

/** Asks which there are; a choice of one that is gone is forgotten. */
export async function lookAtProjects() {
  const { name: me } = session.value;
  try {
    const found = /** @type {{name: string, roles?: Record<string, string>}[]} */ (await getAll("/projects"));
    onlySeen.clear();
    for (const { name, roles } of found) if (!may("admin") && roles?.[me ?? ""] === "view") onlySeen.add(name);
    projects.set(found.map(({ name }) => name));
  } catch {
    return; // the page says by itself that the service does not answer
  }
  if (!projects.value.includes(chosenProject() ?? "")) chooseProject(null);
}

/** @param {string | null | undefined} project that something is in, empty: none @returns {boolean} whether one may change and add things there */
export const mayChange = (project) => may("submit") && !onlySeen.has(project ?? "");

/** @param {string | null | undefined} project in which one may not @returns {string} a sentence */
export const whyNot = (project) =>
  may("submit")
    ? t("You can look at project {name}, but not change it. Ask whoever runs this farm.", { name: project ?? "" })
    : t("Your role lets you look, but not render. Ask whoever runs this farm.");

/** What is in a part of the page is in a project: what would be refused there is not offered. @param {HTMLElement} part @param {string | null | undefined} project */
export function offer(part, project) {
  part.dataset.may = mayChange(project) ? "submit" : "view";
}
