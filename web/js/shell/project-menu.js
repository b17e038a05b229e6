/** The switch of project, for whom there are any: a change loads the page anew. */

import { h } from "../base/dom.js";
import { chooseProject, chosenProject } from "../base/project.js";
import { t } from "../base/words.js";
import { projects } from "../news/projects.js";

/** @returns {HTMLElement | null} */
export function projectMenu() {
  if (projects.value.length === 0) return null;
  const chosen = chosenProject();
  const menu = h(
    "select",
    { class: "project-menu", "aria-label": t("Project"), title: t("Project: what you upload and render goes there, and its members alone see it") },
    h("option", { value: "", selected: chosen === null }, t("All projects")),
    projects.value.map((name) => h("option", { value: `p:${name}`, selected: name === chosen }, name)),
  );
  menu.addEventListener("change", () => {
    chooseProject(menu.value ? menu.value.slice(2) : null);
    location.hash = "#/"; // what is open may be another project's
    location.reload();
  });
  return menu;
}
