/** For administrators: the projects with their members and roles. */

import { addProject, chooseUsers, getProjects, addMember, removeMember, removeProject } from "../news/access.js";
import { fill, h } from "../base/dom.js";
import { t, tn } from "../base/words.js";
import { loadProjects } from "../news/projects.js";
import { announce, showError } from "../shell/tray.js";
import { choice, field, removing, section, submitted, tried } from "./access-pieces.js";

/** @typedef {import("../news/access.js").Project} Project */
/** @typedef {"view" | "submit"} MemberRole */

/** @type {[MemberRole, string][]} */
const ROLES = [
  ["view", t("View: look")],
  ["submit", t("Submit: render too")],
];

export function projectsSection() {
  const list = h("ul", { class: "rows projects" });
  /** Names of expanded projects, preserved when the list is rebuilt. @type {Set<string>} */
  const open = new Set();
  const show = async () => {
    const [projects, users] = await Promise.all([getProjects(), chooseUsers()]);
    list.hidden = projects.length === 0;
    const names = users.map((user) => user.name);
    fill(list, projects.map((project) => projectRow(project, names, open, show)));
  };
  const name = h("input", { type: "text", required: true, maxLength: 63, autocapitalize: "none", spellcheck: "false", autocomplete: "off" });
  const form = h(
    "form",
    {
      class: "account-form",
      onsubmit: (/** @type {Event} */ event) =>
        submitted(event, async () => {
          const made = await addProject(name.value.trim().toLowerCase());
          form.reset();
          open.add(made.name);
          await Promise.all([show(), loadProjects()]);
        }),
    },
    field("project-name", t("Name"), name),
    h("button", { class: "button", type: "submit" }, t("Create a project")),
  );
  show().catch((error) => showError(t("The projects cannot be shown"), error));
  const about = t("Only members and administrators see what is uploaded to a project and rendered from it.");
  return section(t("Projects"), h("p", { class: "quiet about" }, about), list, form);
}

/** @param {Project} project @param {string[]} users @param {Set<string>} open @param {() => Promise<void>} show */
function projectRow(project, users, open, show) {
  const { name, members } = project;
  const others = users.filter((user) => !members.includes(user));
  const isEmpty = Object.values(project.counts).every((count) => !count);
  const title = isEmpty ? t("Remove {name}", { name }) : t("Only an empty project can be removed");
  const remove = removing(title, () =>
    tried(async () => {
      await removeProject(name);
      await Promise.all([show(), loadProjects()]);
    }),
  );
  remove.disabled = !isEmpty;
  const details = h(
    "details",
    { open: open.has(name), ontoggle: () => void (details.open ? open.add(name) : open.delete(name)) },
    h("summary", null, h("strong", null, name), h("span", { class: "quiet small" }, aboutOf(project))),
    h(
      "div",
      { class: "members" },
      members.length > 0 && h("ul", { "aria-label": t("Members of {name}", { name }) }, members.map((user) => memberRow(project, user, show))),
      others.length > 0 ? newMember(project, others, show) : h("p", { class: "quiet small" }, t("All users are members.")),
    ),
  );
  return h("li", { class: "project-row" }, details, remove);
}

/** @param {Project} project @param {string} user @param {() => Promise<void>} show */
function memberRow(project, user, show) {
  const now = project.roles[user] ?? "submit";
  const role = choice(ROLES, now, { "aria-label": t("Role of {name} in {project}", { name: user, project: project.name }) });
  role.addEventListener("change", () =>
    void addMember(project.name, user, /** @type {MemberRole} */ (role.value)).then(
      () => announce(t("The new role applies now")),
      (error) => {
        role.value = now;
        showError(t("The change was not made"), error);
      },
    ),
  );
  const away = removing(t("Take {name} out of {project}", { name: user, project: project.name }), () => tried(() => removeMember(project.name, user).then(show)));
  return h("li", null, h("span", null, user), role, away);
}

/** @param {Project} project @param {string[]} others @param {() => Promise<void>} show */
function newMember(project, others, show) {
  const user = choice(others.map((name) => [name, name]), others[0] ?? "", { "aria-label": t("New member of {project}", { project: project.name }) });
  const role = choice(ROLES, "submit", { "aria-label": t("Role of the new member of {project}", { project: project.name }) });
  return h(
    "form",
    { onsubmit: (/** @type {Event} */ event) => submitted(event, () => addMember(project.name, user.value, /** @type {MemberRole} */ (role.value)).then(show)) },
    user,
    role,
    h("button", { class: "button small", type: "submit" }, t("Add")),
  );
}

/** @param {Project} project */
function aboutOf({ members, counts }) {
  const parts = [members.length ? tn(members.length, "{n} member", "{n} members") : t("no members")];
  if (counts.scene) parts.push(tn(counts.scene, "{n} scene", "{n} scenes"));
  if (counts.job) parts.push(tn(counts.job, "{n} picture", "{n} pictures"));
  return parts.join(" · ");
}
