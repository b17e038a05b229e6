/** How machines join this farm: the commands for the way in which it was started. */

import { makeToken } from "../news/access.js";
import { fill, h } from "../base/dom.js";
import { session } from "../news/session.js";
import { command } from "../shell/hints.js";
import { showError } from "../shell/tray.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Joining} Joining */

/** Whether this page was opened by a loopback address, which other machines cannot use. */
const isLoopback = () => ["localhost", "127.0.0.1", "[::1]"].includes(location.hostname);

/** The farm's address for other machines; null if they do not reach it. @param {Joining} joining */
const joinUrl = ({ url }) => (isLoopback() ? url : location.origin);

/** @param {Joining} joining @returns {HTMLElement} */
export function addMachine(joining) {
  const url = joinUrl(joining);
  return url ? reachable(joining, url) : unreachable(joining);
}

/** @param {Joining} joining */
function unreachable({ start }) {
  return h(
    "div",
    { class: "add-machine stack tight" },
    h("p", null, t("Other machines cannot reach this farm yet.")),
    ...(start
      ? [
          h("p", { class: "quiet" }, t("Stop the farm, and start it again with this command. This page then shows the command for other machines.")),
          command(start),
        ]
      : []),
    h("p", { class: "quiet" }, h("a", { href: "docs/guides/remote-workers" }, t("Machines elsewhere, over HTTPS"))),
  );
}

/** @param {Joining} joining @param {string} url */
function reachable({ token, program }, url) {
  const elsewhere = h("p", { class: "quiet" }, h("a", { href: "docs/guides/remote-workers" }, t("Machines elsewhere, over HTTPS")));
  const there = h("p", { class: "quiet" }, t("On the other machine, with the same version of Rayfarm installed:"));
  if (!session.value.login)
    return h(
      "div",
      { class: "add-machine stack tight" },
      h("p", { class: "quiet" }, t("Create a token for it on the farm's machine, and copy the file:")),
      command(token),
      there,
      command(`${program} worker --join ${url} --token-file NAME.token`),
      elsewhere,
    );
  const join = h("div", null, command(`RAYFARM_TOKEN=TOKEN ${program} worker --join ${url}`));
  const first = h("p", { class: "quiet", role: "status" }, t("Each machine gets a token of its own."));
  const make = h("button", { class: "button", type: "button" }, t("Create a token"));
  make.addEventListener("click", async () => {
    make.disabled = true;
    try {
      const { secret } = await makeToken(t("Worker, {day}", { day: new Date().toLocaleDateString() }), "worker", null);
      fill(join, command(`RAYFARM_TOKEN=${secret} ${program} worker --join ${url}`));
      first.textContent = t("The command has a new token, which is shown only once.");
    } catch (error) {
      showError(t("No token was created"), error);
    } finally {
      make.disabled = false;
    }
  });
  return h("div", { class: "add-machine stack tight" }, first, h("div", null, make), there, join, elsewhere);
}
