/** The project menu, shown to members of any project; a change reloads the page. */

import { fill, h } from "../base/dom.js";
import { chooseProject, chosenProject } from "../base/project.js";
import { t } from "../base/words.js";
import { projects } from "../news/projects.js";

/** @returns {HTMLElement} hidden without projects */
export function projectMenu() {
  const chosen = chosenProject();
  const menu = h("select", { class: "project-menu", "aria-label": t("Project"), title: t("Project: your uploads and pictures go there, and only its members see them") });
  projects.subscribe((names) => {
    menu.hidden = names.length === 0;
    fill(
      menu,
      h("option", { value: "", selected: chosen === null }, t("All projects")),
      names.map((name) => h("option", { value: `p:${name}`, selected: name === chosen }, name)),
    );
  });
  menu.addEventListener("change", () => {
    chooseProject(menu.value ? menu.value.slice(2) : null);
    location.hash = "#/"; // the current view may belong to another project
    location.reload();
  });
  return menu;
}
