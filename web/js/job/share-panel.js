/** Links that show a job to people without an account: create, copy, withdraw. */

import { getShares, makeShare, withdrawShare } from "../news/access.js";
import { jobLook } from "../film/job-look.js";
import { fill, h } from "../base/dom.js";
import { command } from "../shell/hints.js";
import { announce, showError } from "../shell/tray.js";
import { t } from "../base/words.js";

/** @typedef {import("../news/access.js").Share} Share */

/** @type {[number, string][]} */
const LASTING = [
  [1, t("1 day")],
  [7, t("7 days")],
  [30, t("30 days")],
];

/** @type {[import("../news/access.js").Permission, string, string][]} */
const PERMISSIONS = [
  ["view", t("View only"), t("Shows this picture only, without an account. The address is shown only once.")],
  ["comment", t("View and notes"), t("Shows this picture and its notes, without an account; guests can write notes and approve. The address is shown only once.")],
];

/**
 * @param {import("../base/types.js").Job} shown
 * @param {() => Record<string, string | number>} look parameters of the picture as it is displayed, which links carry
 * @returns {HTMLElement}
 */
export function sharePanel(shown, look) {
  const job = shown.id;
  const { exposure, curve } = jobLook(shown);
  /** Parameters that a link's picture has without them. @type {Record<string, string | number>} */
  const usual = { exposure, tonemap: curve };
  const days = h("select", { "aria-label": t("Valid for") }, LASTING.map(([value, label]) => h("option", { value, selected: value === 7 }, label)));
  const permission = h("select", { "aria-label": t("Permission") }, PERMISSIONS.map(([value, label]) => h("option", { value }, label)));
  const create = h("button", { class: "button small", type: "button", onclick: () => make() }, t("Create link"));
  const made = h("div", { class: "share-made" });
  const list = h("ul", { class: "share-links small" });
  /** @param {Share[]} shares */
  const show = (shares) => fill(list, shares.map(row));
  const load = () => getShares(job).then(show, (error) => {
    // Those who only view the job's project may not share it.
    if (error.status !== 403) showError(t("The links cannot be shown"), error, { ofPage: true });
  });
  const make = async () => {
    create.disabled = true;
    try {
      const [allowed, , words] = PERMISSIONS[permission.selectedIndex] ?? ["view", "", ""];
      const url = await makeShare(job, Number(days.value), allowed);
      const changed = Object.entries(look()).filter(([name, value]) => usual[name] !== value);
      const query = new URLSearchParams(changed.map(([name, value]) => [name, String(value)]));
      fill(made, command(query.size ? `${url}?${query}` : url, t("Copy the link")), h("p", { class: "quiet small" }, words));
      announce(t("Link created"));
      await load();
    } catch (error) {
      showError(t("No link was created"), error, { ofPage: true });
    } finally {
      create.disabled = false;
    }
  };
  /** @param {Share} share */
  const row = (share) => {
    const until = t("until {time}", { time: new Date((share.expires ?? 0) * 1000).toLocaleString([], { dateStyle: "medium", timeStyle: "short" }) });
    const withdraw = async () => {
      try {
        await withdrawShare(job, share.id);
        fill(made);
        announce(t("Link withdrawn"));
        await load();
      } catch (error) {
        showError(t("The link was not withdrawn"), error, { ofPage: true });
      }
    };
    return h(
      "li",
      { class: "row spread" },
      h("span", { class: "number" }, until, h("span", { class: "quiet" }, ` · ${share.user}${share.permission === "comment" ? ` · ${t("notes")}` : ""}`)),
      h("button", { class: "text-button", type: "button", "aria-label": t("Withdraw the link {until}", { until }), onclick: withdraw }, t("Withdraw")),
    );
  };
  void load();
  return h(
    "section",
    { class: "side-section stack tight for-submit", "aria-label": t("Share") },
    h("h2", null, t("Share")),
    h("div", { class: "row" }, permission, days),
    h("div", null, create),
    made,
    list,
  );
}
