/** The account page: the user's password, tokens and logout; for administrators also those of others. */

import { h } from "../base/dom.js";
import { t } from "../base/words.js";
import { changePassword, logOut, may, session } from "../news/session.js";
import { setTitle } from "../shell/router.js";
import { announce, showError } from "../shell/tray.js";
import { auditSection, tokensSection, usersSection } from "./access-parts.js";
import { limitsSection } from "./limits-section.js";
import { projectsSection } from "./projects-section.js";
import { quotaSection } from "./quota.js";

/** Descriptions of the roles. */
const ROLES = /** @type {Record<string, string>} */ ({
  view: t("You can view everything."),
  submit: t("You can view everything, upload scenes and render."),
  admin: t("You can do everything, including managing users."),
});

/** @returns {{element: HTMLElement, dispose: () => void}} */
export function accountView() {
  setTitle(t("Account"));
  const { name, role, kind } = session.value;
  const leave = h("button", { class: "button", type: "button", onclick: () => void logOut().catch((error) => showError(t("Not logged out"), error)) }, t("Log out"));
  const element = h(
    "div",
    { class: "page account" },
    h("header", { class: "account-head" }, h("div", null, h("h1", { class: "page-title" }, kind === "open" ? t("This machine") : (name ?? "")), h("p", { class: "quiet" }, ROLES[role ?? ""] ?? "")), kind === "session" && leave),
    kind === "session" && name !== "owner" && passwordSection(),
    kind === "session" && quotaSection(),
    kind === "session" && tokensSection(),
    kind === "session" && may("admin") && usersSection(),
    kind === "session" && may("admin") && projectsSection(),
    kind === "session" && may("admin") && limitsSection(),
    kind === "session" && may("admin") && auditSection(),
  );
  return { element, dispose: () => {} };
}

function passwordSection() {
  const old = h("input", { id: "password-old", type: "password", autocomplete: "current-password" });
  const next = h("input", { id: "password-new", type: "password", autocomplete: "new-password", required: true, minLength: 10 });
  const problem = h("p", { class: "problem", role: "alert" });
  const form = h(
    "form",
    {
      class: "account-form",
      onsubmit: async (/** @type {Event} */ event) => {
        event.preventDefault();
        problem.textContent = "";
        try {
          await changePassword(old.value, next.value);
          form.reset();
          announce(t("The password is changed"));
          problem.textContent = "";
          done.hidden = false;
        } catch (error) {
          done.hidden = true;
          problem.textContent = /** @type {Error} */ (error).message;
        }
      },
    },
    h("div", { class: "field" }, h("label", { for: "password-old" }, t("Current password")), old, h("span", { class: "hint" }, t("Leave empty if you have none yet."))),
    h("div", { class: "field" }, h("label", { for: "password-new" }, t("New password")), next, h("span", { class: "hint" }, t("At least 10 characters; a few words are best."))),
    h("button", { class: "button", type: "submit" }, t("Change the password")),
  );
  const done = h("p", { class: "quiet", hidden: true }, t("The password is changed. All other browsers are logged out."));
  return h("section", { class: "section" }, h("header", null, h("h2", null, t("Password"))), form, problem, done);
}
