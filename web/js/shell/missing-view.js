/** The error page for a view whose modules could not be fetched. */

import { fill, h } from "../base/dom.js";
import { emptyPage } from "./hints.js";
import { announce } from "./tray.js";
import { t } from "../base/words.js";

/** The version in the URLs of this page's files; empty if they are served without one. */
const VERSION = /\/(v\/\w+\/)/.exec(import.meta.url)?.[1] ?? "";

/** @returns {Promise<boolean | null>} whether the service now has another version of the page; null: no response */
export async function isOutdated() {
  try {
    const response = await fetch("./", { cache: "no-store" });
    return response.ok ? !(await response.text()).includes(VERSION) : null;
  } catch {
    return null;
  }
}

/** @returns {{element: HTMLElement, dispose: () => void}} */
export function missingView() {
  const why = h("p", { role: "status" });
  const element = h("div", { class: "page" });
  // Browsers cache a module's failure, so the page has to be reloaded.
  const again = async () => {
    if ((await look()) === null) announce(why.textContent ?? "");
    else location.reload();
  };
  const button = h("button", { class: "button primary", type: "button", onclick: again }, t("Reload the page"));
  /** @param {string} title */
  const show = (title) => fill(element, emptyPage("warning", title, why, button));
  async function look() {
    const found = await isOutdated();
    if (found) show(t("Rayfarm was updated"));
    if (found) why.textContent = t("This tab has the previous version. Reload the page to continue.");
    else why.textContent = found === null ? t("The service does not answer at the moment.") : t("The connection was lost.");
    return found;
  }
  show(t("This part of the page could not be loaded"));
  void look();
  return { element, dispose: () => {} };
}
