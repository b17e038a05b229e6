/** Sections of the account page: tokens, users, and the audit log. */

import { fill, h } from "../base/dom.js";
import { ago } from "../base/format.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { addUser, getAudit, getTokens, getUsers, makeLink, makeToken, removeUser, setRole, withdrawToken } from "../news/access.js";
import { Listing } from "../news/listing.js";
import { may, session } from "../news/session.js";
import { moreButton } from "../shell/more-button.js";
import { announce, showError } from "../shell/tray.js";
import { ROLES, choice, field, once, removing, section, submitted } from "./access-pieces.js";

/** @typedef {import("../news/access.js").Role} Role */

const LINES = 50;
/** @type {[string, string][]} */
const LASTING = [
  ["30", t("30 days")],
  ["90", t("90 days")],
  ["365", t("A year")],
  ["", t("Until withdrawn")],
];

/** Access tokens; administrators see those of all users and of workers. */
export function tokensSection() {
  const list = h("ul", { class: "rows" });
  const told = h("div", null);
  const tokens = new Listing((offset) => getTokens(may("admin"), offset));
  const show = () => tokens.load();
  tokens.subscribe((all) => {
    list.hidden = !all?.length;
    fill(list, (all ?? []).map((token) => tokenRow(token, show)));
  });
  const roles = /** @type {[string, string][]} */ ([...ROLES.filter(([role]) => may(role)), ...(may("admin") ? [["worker", t("Worker")]] : [])]);
  const name = h("input", { type: "text", required: true, maxLength: 100 });
  const role = choice(roles, may("submit") ? "submit" : "view");
  const days = choice(LASTING, "90");
  const form = h(
    "form",
    {
      class: "account-form",
      onsubmit: (/** @type {Event} */ event) =>
        submitted(event, async () => {
          const made = await makeToken(name.value, /** @type {Role | "worker"} */ (role.value), days.value ? Number(days.value) : null);
          form.reset();
          fill(told, once(t("The token for {name}. It is shown only once.", { name: made.name }), made.secret));
          await show();
        }),
    },
    field("token-name", t("Purpose"), name),
    field("token-role", t("Role"), role),
    field("token-days", t("Valid for"), days),
    h("button", { class: "button", type: "submit" }, t("Create a token")),
  );
  show().catch((error) => showError(t("The tokens cannot be shown"), error));
  return section(t("Tokens"), h("p", { class: "quiet about" }, t("Programs and workers use a token to get in.")), list, moreButton(tokens).element, form, told);
}

/** @param {import("../news/access.js").Token} token @param {() => Promise<void>} show */
function tokenRow(token, show) {
  const label = [...ROLES, ["worker", t("Worker")]].find(([role]) => role === token.role)?.[1] ?? token.role;
  const until = token.expires === null ? t("until withdrawn") : t("until {day}", { day: new Date(token.expires * 1000).toLocaleDateString() });
  const seen = token.seen === null ? t("never shown") : t("last shown {ago}", { ago: ago(token.seen) });
  return h(
    "li",
    { class: "access-row" },
    h("div", null, h("strong", null, token.name), h("div", { class: "quiet small" }, `${token.user} · ${until} · ${seen}`)),
    h("span", { class: "chip" }, label),
    removing(t("Withdraw {name}", { name: token.name }), () =>
      void withdrawToken(token.id).then(show).catch((error) => showError(t("Not withdrawn"), error)),
    ),
  );
}

/** For administrators: the users. */
export function usersSection() {
  const list = h("ul", { class: "rows" });
  const told = h("div", null);
  const users = new Listing(getUsers);
  const show = () => users.load();
  users.subscribe((all) => {
    list.hidden = !all?.length;
    fill(list, (all ?? []).map((user) => userRow(user, show, tell)));
  });
  /** @param {string} name */
  const tell = async (name) => fill(told, once(t("This link logs {name} in. It works once, within a day.", { name }), await makeLink(name)));
  const name = h("input", { type: "text", required: true, maxLength: 63, autocapitalize: "none", spellcheck: "false", autocomplete: "off" });
  const role = choice(ROLES, "submit");
  const form = h(
    "form",
    {
      class: "account-form",
      onsubmit: (/** @type {Event} */ event) =>
        submitted(event, async () => {
          const user = await addUser(name.value.trim().toLowerCase(), /** @type {Role} */ (role.value));
          form.reset();
          await Promise.all([tell(user.name), show()]);
        }),
    },
    field("user-name", t("Name"), name),
    field("user-role", t("Role"), role),
    h("button", { class: "button", type: "submit" }, t("Add a user")),
  );
  show().catch((error) => showError(t("The users cannot be shown"), error));
  return section(t("Users"), list, moreButton(users).element, form, told);
}

/** @param {import("../news/access.js").User} user @param {() => Promise<void>} show @param {(name: string) => Promise<void>} tell */
function userRow(user, show, tell) {
  const { name } = user;
  const role = choice(ROLES, user.role, { "aria-label": t("Role of {name}", { name }) });
  role.addEventListener("change", () =>
    void setRole(name, /** @type {Role} */ (role.value)).then(
      () => announce(t("The new role applies now")),
      (error) => {
        role.value = user.role;
        showError(t("The change was not made"), error);
      },
    ),
  );
  const about = user.has_password ? t("has a password") : t("by link");
  return h(
    "li",
    { class: "access-row user-row" },
    h("div", null, h("strong", null, name), h("div", { class: "quiet small" }, user.sessions ? `${about} · ${t("logged in")}` : about)),
    role,
    h("button", { class: "button small", type: "button", onclick: () => void tell(name).catch((error) => showError(t("The change was not made"), error)) }, icon("link"), t("Link")),
    name === session.value.name
      ? h("span", null)
      : removing(t("Remove {name}", { name }), () => void removeUser(name).then(show).catch((error) => showError(t("The change was not made"), error))),
  );
}

/** For administrators: the audit log. */
export function auditSection() {
  const body = h("tbody", null);
  const show = async () =>
    fill(
      body,
      (await getAudit(LINES)).map(({ at, who, what, about, from, status }) =>
        h(
          "tr",
          { class: (status ?? 0) >= 400 && "refused" },
          h("td", { class: "number" }, new Date(at * 1000).toLocaleString()),
          h("td", null, who || "–"),
          h("td", null, h("code", null, what), about && h("span", { class: "quiet small" }, ` ${about}`)),
          h("td", { class: "number" }, status ?? ""),
          h("td", { class: "quiet number" }, from ?? ""),
        ),
      ),
    );
  const details = h(
    "details",
    { class: "audit", ontoggle: () => details.open && void show().catch((error) => showError(t("The audit log cannot be shown"), error)) },
    h("summary", null, t("Who did what")),
    h("div", { class: "scrolls", tabIndex: 0 }, h("table", null, h("thead", null, h("tr", null, [t("Time"), t("User"), t("Action"), t("Status"), t("From")].map((head) => h("th", { scope: "col" }, head)))), body)),
  );
  return section(t("Audit log"), details);
}
