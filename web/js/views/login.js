/** The login page: a name and a password, or the code of a one-time link. */

import { h } from "../base/dom.js";
import { t } from "../base/words.js";
import { logIn, session as known } from "../news/session.js";
import { languageMenu } from "../shell/language-menu.js";
import { here, setTitle } from "../shell/router.js";

/** Relative to the modules, so with the same version in the URL. */
const ICON = new URL("../../icon.svg", import.meta.url).href;

/** Why the login through the OpenID provider was refused, as named in service/access/oidc.py. @type {string | null} */
let refused = null;

/** @type {Record<string, string>} */
const REFUSED = {
  cancelled: t("The login was not finished at the provider. Try again."),
  late: t("That login was begun too long ago, or in another browser. Try again."),
  provider: t("The provider cannot be reached, or its answer is not right. Try again, or ask the administrator of this farm."),
  role: t("You are logged in at the provider, but have no role here. Ask the administrator of this farm."),
  name: t("This name is already in use or not allowed here. Ask the administrator of this farm."),
};

/**
 * Returns the code from the URL and removes it there at once, so that it does not stay in the history or in copied addresses.
 *
 * @returns {string | null}
 */
export function takeCode() {
  const { path, params } = here();
  if (path[0] !== "login") return null;
  refused = params.get("refused");
  history.replaceState(null, "", location.pathname);
  return params.get("code");
}

/**
 * @param {string | null} code
 * @returns {{element: HTMLElement, dispose: () => void}}
 */
export function loginView(code) {
  setTitle(t("Log in"));
  const name = h("input", { id: "login-name", type: "text", autocomplete: "username", autocapitalize: "none", spellcheck: "false", required: true });
  const password = h("input", { id: "login-password", type: "password", autocomplete: "current-password", required: true });
  const button = h("button", { class: "button primary large", type: "submit" }, t("Log in"));
  const problem = h("p", { class: "problem", role: "alert" });

  /** @param {Parameters<typeof logIn>[0]} shown */
  const enter = async (shown) => {
    button.disabled = true;
    problem.textContent = "";
    try {
      const session = await logIn(shown);
      // Without a password, one is set next; otherwise the page continues to the address of this visit.
      if ("link" in shown && session.name !== "owner") history.replaceState(null, "", "#/account");
      location.reload();
    } catch (error) {
      button.disabled = false;
      problem.textContent = /** @type {Error} */ (error).message;
      password.value = "";
      (name.value ? password : name).focus();
    }
  };
  const form = h(
    "form",
    {
      class: "login-card",
      onsubmit: (/** @type {Event} */ event) => {
        event.preventDefault();
        void enter({ name: name.value.trim().toLowerCase(), password: password.value });
      },
    },
    h("header", null, h("img", { src: ICON, alt: "" }), h("h1", null, t("Log in to Rayfarm")), languageMenu()),
    h("div", { class: "field" }, h("label", { for: "login-name" }, t("Name")), name),
    h("div", { class: "field" }, h("label", { for: "login-password" }, t("Password")), password),
    problem,
    button,
    known.value.provider && h("a", { class: "button large", href: "api/login/openid" }, t("Log in with {provider}", { provider: known.value.provider })),
    h("p", { class: "quiet" }, t("No password yet? Ask the administrator of this farm for a link.")),
  );
  if (refused) problem.textContent = REFUSED[refused] ?? "";
  if (code) void enter({ link: code });
  else queueMicrotask(() => name.focus());
  return { element: h("div", { class: "login" }, form), dispose: () => {} };
}
