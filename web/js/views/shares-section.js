/**
 * Fair shares: a row with weight and limit for each user and each project with its own share. Collapsed, since few farms need
 * it.
 */

import { getShares, resetShare, setShare } from "../news/shares.js";
import { fill, h, keyedList, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { Listing } from "../news/listing.js";
import { projects } from "../news/projects.js";
import { may } from "../news/session.js";
import { moreButton } from "../shell/more-button.js";
import { showError } from "../shell/tray.js";

/** @typedef {import("../news/shares.js").Share} Share */

const RENEW_MS = 4000;

/** @param {import("../base/store.js").Disposer} life @returns {HTMLElement} */
export function sharesSection(life) {
  const body = h("tbody", null);
  const show = keyedList(body, (/** @type {Share} */ { share }) => share, () => shareRow(() => void renew()));
  const project = h("select", { "aria-label": t("Project") });
  const form = h(
    "form",
    {
      class: "row new-share",
      hidden: true,
      onsubmit: (/** @type {Event} */ event) => {
        event.preventDefault();
        setShare(`project:${project.value}`, { weight: 1, max_slots: null }).then(renew, (error) => showError(t("The share was not changed"), error));
      },
    },
    project,
    h("button", { class: "button small", type: "submit" }, t("Add share")),
  );
  let offered = "";
  /** @param {Share[]} all */
  const offer = (all) => {
    const free = projects.value.filter((name) => !all.some(({ share }) => share === `project:${name}`));
    const areAllKnown = !shares.hasMore || !all.at(-1)?.share.startsWith("project:"); // projects come before users
    form.hidden = free.length === 0 || !areAllKnown || !may("admin");
    if (free.join() === offered) return; // keeps an open menu open
    offered = free.join();
    fill(project, free.map((name) => h("option", { value: name }, name)));
  };
  const empty = h("p", { class: "quiet", hidden: true }, t("No jobs, and no shares set: all users share equally."));
  const table = h(
    "table",
    { class: "shares number" },
    h("thead", null, h("tr", null, [t("Owner"), t("Weight"), t("Max slots"), t("Slots now"), t("Jobs")].map((head) => h("th", { scope: "col" }, head)), h("td", null))),
    body,
  );
  const shares = new Listing(getShares);
  const more = moreButton(shares);
  life.add(more.dispose);
  life.add(
    shares.subscribe((all) => {
      if (all === null) return;
      show(all);
      offer(all);
      table.hidden = !(empty.hidden = all.length > 0);
    }),
  );
  const renew = async () => {
    if (!details.open) return;
    try {
      await shares.load();
    } catch (error) {
      if (!body.children.length) showError(t("The shares cannot be shown"), error);
    }
  };
  const details = h(
    "details",
    { class: "section shares-section", ontoggle: () => void renew() },
    h("summary", null, h("h2", null, t("Shares")), " ", h("span", { class: "quiet small" }, t("how users and projects share the workers"))),
    h(
      "div",
      { class: "stack" },
      h("p", { class: "quiet about" }, t("Jobs of equal priority share the slots by owner, in proportion to these weights. What one does not use goes to the others.")),
      h("p", { class: "quiet about" }, t("A project with a share of its own covers all jobs in it, whoever submitted them.")),
      h("div", { class: "scrolls", tabIndex: 0 }, table),
      more.element,
      empty,
      form,
    ),
  );
  life.every(RENEW_MS, () => void renew());
  return details;
}

/** @param {() => void} changed @returns {import("../base/dom.js").Row<Share>} */
function shareRow(changed) {
  /** @type {Share | null} */
  let latest = null;
  const name = h("th", { scope: "row" });
  const reset = h("button", { class: "icon-button", type: "button" }, icon("undo"));
  reset.addEventListener("click", () => latest && void resetShare(latest.share).then(changed, (error) => showError(t("The share was not changed"), error)));
  const weight = h("input", { type: "number", min: 0.001, max: 1000000, step: "any", required: true });
  const slots = h("input", { type: "number", min: 1, max: 1000000, step: 1, placeholder: t("no limit") });
  const now = h("td");
  const jobs = h("td");
  const ask = async () => {
    if (!latest || !weight.validity.valid || !slots.validity.valid) return;
    try {
      update(await setShare(latest.share, { weight: Number(weight.value), max_slots: slots.value ? Number(slots.value) : null }));
    } catch (error) {
      showError(t("The share was not changed"), error);
    }
  };
  for (const input of [weight, slots]) {
    input.addEventListener("change", () => void ask());
    input.disabled = !may("admin");
  }
  /** @param {Share} share */
  const update = (share) => {
    latest = share;
    const isProject = share.share.startsWith("project:");
    const who = share.share.replace(/^(user|project):/, "");
    const label = share.share === "everybody" ? t("Everybody") : isProject ? t("Project {name}", { name: who }) : who;
    setText(name, label);
    name.title = label;
    const away = isProject ? t("Remove the share of {name}: its jobs count towards their users", { name: label }) : t("Remove the share of {name}", { name: label });
    reset.title = away;
    reset.setAttribute("aria-label", away);
    reset.hidden = !may("admin") || (!isProject && share.weight === 1 && share.max_slots === null);
    weight.setAttribute("aria-label", t("Weight of {name}", { name: label }));
    slots.setAttribute("aria-label", t("Slots of {name} at most", { name: label }));
    for (const [input, value] of /** @type {[HTMLInputElement, string][]} */ ([[weight, String(share.weight)], [slots, share.max_slots ? String(share.max_slots) : ""]]))
      if (input !== document.activeElement && input.value !== value) input.value = value;
    setText(now, share.slots);
    setText(jobs, share.jobs);
  };
  return { element: h("tr", null, name, h("td", null, weight), h("td", null, slots), now, jobs, h("td", null, reset)), update };
}
