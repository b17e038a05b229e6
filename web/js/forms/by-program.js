/** The form's request as program code, as a starting point for scripts. */

import { h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { session } from "../news/session.js";
import { announce } from "../shell/tray.js";

/** @typedef {import("../base/types.js").JobRequest} JobRequest */

/**
 * @param {() => JobRequest} request as the form is now
 * @returns {{element: HTMLDetailsElement, update: () => void}}
 */
export function byProgram(request) {
  const ways = [
    { name: "curl", write: asCurl },
    { name: "Python", write: asPython },
  ].map(({ name, write }) => ({ write, code: h("code", { tabIndex: 0, "aria-label": name }), name }));
  const element = h(
    "details",
    { class: "by-program" },
    h("summary", null, h("span", { class: "title" }, t("API"))),
    h("div", { class: "stack" }, h("p", { class: "quiet small" }, t("This request as a script.")), ways.map(({ name, code }) => h("div", { class: "stack tight" }, h("div", { class: "row spread" }, h("span", { class: "label" }, name), copying(code, name)), code))),
  );
  const update = () => {
    if (!element.open) return;
    const asked = request();
    for (const { write, code } of ways) setText(code, write(asked, new URL(".", location.href).href.replace(/\/$/, "")));
  };
  element.addEventListener("toggle", update);
  return { element, update };
}

/** @param {HTMLElement} code @param {string} name */
function copying(code, name) {
  const label = t("Copy for {name}", { name });
  const button = h("button", { class: "icon-button", type: "button", "aria-label": label, title: label }, icon("copy"));
  button.hidden = !navigator.clipboard; // only on HTTPS and localhost
  button.addEventListener("click", () => void navigator.clipboard.writeText(code.textContent ?? "").then(() => announce(t("Copied"))));
  return button;
}

/** @param {JobRequest} asked @param {string} farm */
function asCurl(asked, farm) {
  const token = session.value.login ? ' -H "Authorization: Bearer $RAYFARM_API_TOKEN"' : "";
  return `curl -sf${token} ${farm}/api/jobs --json '${JSON.stringify(asked).replaceAll("'", "'\\''")}'`;
}

/** @param {JobRequest} asked @param {string} farm */
function asPython({ scene, ...asked }, farm) {
  const fields = Object.entries(asked).map(([name, value]) => `        ${name}=${literal(value)},\n`);
  return `import rayfarm\n\nwith rayfarm.Client("${farm}") as farm:\n    job = farm.submit(\n        "${scene}",\n${fields.join("")}    )\n    print(farm.wait(job.id).state)`;
}

/** Formats a value as Python code. @param {unknown} value @returns {string} */
function literal(value) {
  if (value === null || value === undefined) return "None";
  if (typeof value === "boolean") return value ? "True" : "False";
  if (Array.isArray(value)) return `[${value.map(literal).join(", ")}]`;
  if (typeof value === "object") return `{${Object.entries(value).map(([name, each]) => `${JSON.stringify(name)}: ${literal(each)}`).join(", ")}}`;
  return JSON.stringify(value);
}
