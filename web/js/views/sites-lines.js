/** The sites that add up their sums: a line each above the machines; empty without sites. */

import { bytes, compact } from "../base/format.js";
import { h, keyedList, setText } from "../base/dom.js";
import { t, tn } from "../base/words.js";
import { workers } from "../news/farm.js";
import { getSites } from "../news/sites.js";

/** @typedef {import("../news/sites.js").Site} Site */

const RENEW_MS = 4000;

/** @param {import("../base/store.js").Disposer} life @returns {HTMLElement} */
export function sitesLines(life) {
  const list = h("ul", { class: "sites quiet number", hidden: true });
  const show = keyedList(list, (/** @type {Site} */ { name }) => name, siteLine);
  let shown = 0;
  const renew = async () => {
    const isAsked = shown || workers.value?.some(({ offer }) => offer?.tags.some((tag) => tag.startsWith("site:")));
    if (!isAsked) return;
    try {
      const all = await getSites();
      show(all);
      shown = all.length;
      list.hidden = shown === 0;
    } catch {
      list.hidden = true; // the banner shows that the service does not respond
    }
  };
  life.every(RENEW_MS, () => void renew());
  life.add(workers.subscribe((all) => void (all && !shown && renew())));
  return list;
}

/** @returns {import("../base/dom.js").Row<Site>} */
function siteLine() {
  const element = h("li", null);
  return {
    element,
    update: (site) =>
      setText(
        element,
        t("Site {name} on {host} combines results for {workers}: {results} results became {sent}, {in} became {out}", {
          name: site.name,
          host: site.host,
          workers: tn(site.workers.length, "{n} worker", "{n} workers"),
          sent: compact(site.sent),
          results: compact(site.results),
          out: bytes(site.bytes_out),
          in: bytes(site.bytes_in),
        }),
      ),
  };
}
