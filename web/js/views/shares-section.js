/** How the slots are shared: a row for each user, with weight and limit. Folded, as most farms never look at it. */

import { getShares, setShare } from "../news/shares.js";
import { h, keyedList, setText } from "../base/dom.js";
import { t } from "../base/words.js";
import { may } from "../news/session.js";
import { showError } from "../shell/tray.js";

/** @typedef {import("../news/shares.js").Share} Share */

const RENEW_MS = 4000;

/** @param {import("../base/store.js").Disposer} life @returns {HTMLElement} */
export function sharesSection(life) {
  const body = h("tbody", null);
  const show = keyedList(body, (/** @type {Share} */ { share }) => share, shareRow);
  const empty = h("p", { class: "quiet", hidden: true }, t("Nobody has jobs or terms: all would share alike."));
  const table = h(
    "table",
    { class: "shares number" },
    h("thead", null, h("tr", null, [t("Whose"), t("Weight"), t("Slots at most"), t("Slots now"), t("Jobs")].map((head) => h("th", { scope: "col" }, head)))),
    body,
  );
  const renew = async () => {
    if (!details.open) return;
    try {
      const all = await getShares();
      show(all);
      table.hidden = !(empty.hidden = all.length > 0);
    } catch (error) {
      if (!body.children.length) showError(t("The shares cannot be shown"), error);
    }
  };
  const details = h(
    "details",
    { class: "section shares-section", ontoggle: () => void renew() },
    h("summary", null, h("h2", null, t("Shares"))),
    h(
      "div",
      { class: "stack" },
      h("p", { class: "quiet about" }, t("Jobs of the same priority share the slots by whose they are, in proportion to the weights. What one does not use the others have.")),
      h("div", { class: "scrolls", tabIndex: 0 }, table),
      empty,
    ),
  );
  life.every(RENEW_MS, () => void renew());
  return details;
}

/** @returns {import("../base/dom.js").Row<Share>} */
function shareRow() {
  /** @type {Share | null} */
  let latest = null;
  const name = h("th", { scope: "row" });
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
    const label = share.share === "everybody" ? t("Everybody") : share.share.replace(/^user:/, "");
    setText(name, label);
    weight.setAttribute("aria-label", t("Weight of {name}", { name: label }));
    slots.setAttribute("aria-label", t("Slots of {name} at most", { name: label }));
    for (const [input, value] of /** @type {[HTMLInputElement, string][]} */ ([[weight, String(share.weight)], [slots, share.max_slots ? String(share.max_slots) : ""]]))
      if (input !== document.activeElement && input.value !== value) input.value = value;
    setText(now, share.slots);
    setText(jobs, share.jobs);
  };
  return { element: h("tr", null, name, h("td", null, weight), h("td", null, slots), now, jobs), update };
}
