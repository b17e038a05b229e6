/** For administrators: the limits of users and tokens, with their use. */

import { chooseTokens, forgetQuota, getQuotas, setQuota } from "../news/access.js";
import { Listing } from "../news/listing.js";
import { moreButton } from "../shell/more-button.js";
import { fill, h, keyedList, setText } from "../base/dom.js";
import { bytes, compact, count } from "../base/format.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { linkTo } from "../shell/router.js";
import { announce, showError } from "../shell/tray.js";
import { field, section, submitted, tried } from "./access-pieces.js";

/** @typedef {import("../news/access.js").Allowance} Allowance */
/** @typedef {import("../news/access.js").Amounts} Amounts */

/**
 * Limits with their display units.
 * @type {{name: keyof Amounts, label: string, unit: number, whole: boolean, said: (n: number) => string}[]}
 */
const AMOUNTS = [
  { name: "bytes", label: t("Uploads and films, GB"), unit: 1e9, whole: false, said: bytes },
  { name: "jobs", label: t("Unfinished jobs"), unit: 1, whole: true, said: count },
  { name: "samples_day", label: t("Samples a day, millions"), unit: 1e6, whole: false, said: compact },
];
const NOTHING = { bytes: null, jobs: null, samples_day: null };

export function limitsSection() {
  /** Names of tokens, by id. @type {Map<string, string>} */
  let named = new Map();
  const list = h("ul", { class: "rows limits", hidden: true });
  const show = keyedList(list, (/** @type {Allowance} */ { whose }) => whose, () => limitRow((whose) => named.get(whose), renew));
  const token = h("select", { id: "limit-token" });
  const form = h(
    "form",
    { class: "account-form", hidden: true, onsubmit: (/** @type {Event} */ event) => submitted(event, () => setQuota(`token:${token.value}`, NOTHING).then(renew)) },
    h("div", { class: "field" }, h("label", { for: "limit-token" }, t("Token")), token),
    h("button", { class: "button", type: "submit" }, t("Limit a token too")),
  );
  const limits = new Listing(getQuotas);
  async function renew() {
    const [, tokens] = await Promise.all([limits.load(), chooseTokens()]);
    const all = limits.value ?? [];
    named = new Map(tokens.map(({ id, name, user }) => [`token:${id}`, t("{name} of {user}", { name, user })]));
    list.hidden = all.length === 0;
    show(all);
    const free = tokens.filter(({ id, role }) => role !== "worker" && !all.some(({ whose }) => whose === `token:${id}`));
    form.hidden = free.length === 0;
    fill(token, free.map(({ id, name, user }) => h("option", { value: id }, t("{name} of {user}", { name, user }))));
  }
  renew().catch((error) => showError(t("The limits cannot be shown"), error));
  const about = h("p", { class: "quiet about" }, t("An empty field means no limit. How slots are shared is set on the Workers page:"), " ", h("a", { href: linkTo("workers") }, t("Shares")));
  limits.subscribe((all) => show(all ?? []));
  return section(t("Limits of users and tokens"), about, list, moreButton(limits).element, form);
}

/**
 * @param {(whose: string) => string | undefined} nameOf a token
 * @param {() => Promise<void>} renew
 * @returns {import("../base/dom.js").Row<Allowance>}
 */
function limitRow(nameOf, renew) {
  /** @type {Allowance | null} */
  let latest = null;
  const name = h("strong");
  const kind = h("div", { class: "quiet small" });
  const fields = AMOUNTS.map(({ name, label, unit, whole, said }, i) => {
    const input = h("input", { type: "number", min: 0, max: 9e9, step: whole ? 1 : "any", placeholder: t("no limit"), inputmode: whole ? "numeric" : "decimal" });
    const used = h("span", { class: "quiet small number" });
    input.addEventListener("change", () => {
      if (latest === null || !input.validity.valid) return;
      ask(latest.whose);
    });
    const element = field(`limit-${(fresh += 1)}-${i}`, label, input);
    element.append(used);
    return { name, unit, said, input, used, element, label };
  });
  // Serialises requests; a response is ignored for fields changed meanwhile.
  let last = Promise.resolve();
  let pending = 0;
  /** @param {string} whose */
  const ask = (whose) => {
    pending += 1;
    const told = last.then(() => setQuota(whose, wanted())).then(() => announce(t("The new limit applies now")), (error) => showError(t("The change was not made"), error));
    last = told.then(() => (pending -= 1)).then(renew).catch((error) => showError(t("The limits cannot be shown"), error));
  };
  /** The fields' values; the previous one for an invalid field. @returns {Amounts} */
  const wanted = () => {
    const said = fields.map(({ name, unit, input }) => {
      const was = latest?.limits[name] ?? null;
      const isSame = Boolean(input.value) && was !== null && amountText(was, unit) === input.value;
      return [name, !input.validity.valid || isSame ? was : input.value ? Math.round(input.valueAsNumber * unit) : null];
    });
    return Object.fromEntries(said);
  };
  const reset = h("button", { class: "icon-button", type: "button" }, icon("undo"));
  reset.addEventListener("click", () => latest && tried(() => forgetQuota(/** @type {Allowance} */ (latest).whose).then(renew)));
  return {
    element: h("li", { class: "limit-row" }, h("div", null, name, kind), fields.map(({ element }) => element), reset),
    update(allowance) {
      latest = allowance;
      const isToken = allowance.whose.startsWith("token:");
      const called = isToken ? (nameOf(allowance.whose) ?? allowance.whose) : allowance.whose.replace(/^user:/, "");
      setText(name, called);
      setText(kind, isToken ? t("token, in addition to its user's") : allowance.is_own ? t("own limits") : t("default limits"));
      const away = isToken ? t("No limits for the token {name}", { name: called }) : t("Use the default limits for {name}", { name: called });
      reset.title = away;
      reset.setAttribute("aria-label", away);
      reset.style.visibility = allowance.is_own ? "" : "hidden";
      for (const { name, unit, said, input, used, label } of fields) {
        const limit = allowance.limits[name];
        const value = limit === null ? "" : amountText(limit, unit);
        if (pending === 0 && input !== document.activeElement && input.value !== value) input.value = value;
        input.setAttribute("aria-label", t("{label}: {name}", { label, name: called }));
        const has = allowance.used[name] ?? 0;
        const isFull = limit !== null && has >= limit;
        used.classList.toggle("full", isFull);
        setText(used, isFull ? t("{used} used: limit reached", { used: said(has) }) : t("{used} used", { used: said(has) }));
      }
    },
  };
}

let fresh = 0;

/** Formats an amount for a field. @param {number} amount @param {number} unit */
const amountText = (amount, unit) => String(Number((amount / unit).toPrecision(12)));
