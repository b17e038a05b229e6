/** Which project the page works in, where the farm asks for a login and one is a member of some. */

import { call } from "./api.js";
import { chooseProject, chosenProject } from "../base/project.js";
import { Store } from "../base/store.js";

/** Those that one sees, by name. @type {Store<string[]>} */
export const projects = new Store(/** @type {string[]} */ ([]));

/** Asks which there are; a choice of one that is gone is forgotten. */
export async function lookAtProjects() {
  try {
    const found = /** @type {{name: string}[]} */ (await call("GET", "/projects"));
    projects.set(found.map(({ name }) => name));
  } catch {
    return; // the page says by itself that the service does not answer
  }
  if (!projects.value.includes(chosenProject() ?? "")) chooseProject(null);
}
