/** The button below a partly loaded list. */

import { h } from "../base/dom.js";
import { t } from "../base/words.js";
import { showError } from "./tray.js";

/**
 * @param {import("../news/listing.js").Listing<any>} listing
 * @returns {{element: HTMLButtonElement, dispose: () => void}}
 */
export function moreButton(listing) {
  const element = h("button", { class: "text-button", type: "button", hidden: true }, t("Show more"));
  element.addEventListener("click", async () => {
    element.disabled = true;
    await listing.more().catch((error) => showError(t("No more could be loaded"), error));
    element.disabled = false;
  });
  return { element, dispose: listing.subscribe(() => (element.hidden = !listing.hasMore)) };
}
