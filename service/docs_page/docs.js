/** The API as a page, from /openapi.json alone: nothing is loaded from elsewhere. */

import { h } from "/js/base/dom.js";
import { addThemeMenu } from "./theme-menu.js";

/** Tags in the order of a user's way; the others follow. */
const FIRST = ["scenes", "jobs", "frames", "workers"];
const METHODS = ["get", "post", "put", "patch", "delete"];

/** Returns the schema to which a $ref of the document leads. */
function resolve(schema, api) {
  if (!schema?.$ref) return schema ?? {};
  return schema.$ref.slice(2).split("/").reduce((at, key) => at[key], api);
}

/** Returns the id of a tag's section: "two words" is at #two-words. */
const anchorOf = (tag) => tag.toLowerCase().replaceAll(" ", "-");

/** A schema's type in a few words. */
function typeName(schema, api) {
  if (schema.$ref) return schema.$ref.split("/").at(-1);
  const any = schema.anyOf ?? schema.oneOf;
  if (any) return any.map((each) => typeName(each, api)).join(" | ");
  if (schema.enum) return schema.enum.map((value) => JSON.stringify(value)).join(" | ");
  if ("const" in schema) return JSON.stringify(schema.const);
  if (schema.prefixItems) return `[${schema.prefixItems.map((each) => typeName(each, api)).join(", ")}]`;
  if (schema.type === "array") return `${typeName(schema.items ?? {}, api)}[]`;
  return schema.format === "binary" ? "file" : schema.type ?? "any";
}

/** What a value may be, beside its type. */
function limits(schema) {
  const inner = schema.anyOf?.find((each) => each.type !== "null") ?? schema;
  const words = [];
  const [least, above, most] = [inner.minimum, inner.exclusiveMinimum, inner.maximum];
  if (least !== undefined && most !== undefined) words.push(`${least} to ${most}`);
  else if (least !== undefined) words.push(`at least ${least}`);
  else if (most !== undefined) words.push(above === undefined ? `at most ${most}` : `above ${above}, at most ${most}`);
  else if (above !== undefined) words.push(`above ${above}`);
  if (schema.default !== undefined && schema.default !== null) words.push(`default ${JSON.stringify(schema.default)}`);
  return words.join(", ");
}

/** Turns `code` in a text into elements. */
const withCode = (text) => text.split("`").map((part, i) => (i % 2 ? h("code", null, part) : part));

function row(name, schema, required, api, description, place) {
  const said = description ?? schema.description ?? resolve(schema, api).description ?? "";
  const about = [said, limits(schema)].filter(Boolean).join(" · ");
  const cells = [[h("code", null, name), place || required ? h("span", { class: "quality" }, [place, required && "required"].filter(Boolean).join(", ")) : ""], [typeName(schema, api)], withCode(about)];
  return h("tr", null, ...cells.map((cell) => h("td", null, ...cell)));
}

function table(caption, rows) {
  const head = h("tr", null, ...["Name", "Type", "Description"].map((text) => h("th", { scope: "col" }, text)));
  return rows.length ? h("div", null, h("h3", null, caption), h("table", null, h("thead", null, head), h("tbody", null, ...rows))) : null;
}

function properties(caption, schema, api, isRequest) {
  const shape = resolve(schema.type === "array" ? schema.items : schema, api);
  const required = new Set(shape.required ?? []);
  const fields = Object.entries(shape.properties ?? {}).sort(([a], [b]) => required.has(b) - required.has(a)); // required ones first
  return table(caption, fields.map(([name, each]) => row(name, each, isRequest && required.has(name), api)));
}

/** Returns an example of a JSON body with its required fields. */
function exampleBody(schema, api) {
  const shape = resolve(schema, api);
  const value = (name) => {
    const field = resolve(shape.properties?.[name], api);
    return { string: name.toUpperCase(), integer: 1, number: 1, boolean: true, array: [], object: {} }[field.type] ?? null;
  };
  return Object.fromEntries((shape.required ?? []).map((name) => [name, value(name)]));
}

/** The commands that send a request, as a starting point for scripts. */
function commands(path, method, about, api) {
  const url = `${location.origin}${path}`;
  const verb = method.toUpperCase();
  const media = Object.keys(about.requestBody?.content ?? {})[0] ?? "";
  const isForm = media.startsWith("multipart/");
  const example = media && !isForm ? JSON.stringify(exampleBody(about.requestBody.content[media].schema, api)).replaceAll(/([:,])/g, "$1 ") : "";
  const body = !media ? "" : isForm ? " \\\n  -F files=@scene.glb" : ` \\\n  --json '${example}'`;
  const sent = !media ? "" : isForm ? ',\n    files={"files": open("scene.glb", "rb")}' : `,\n    json=${example.replaceAll("true", "True").replaceAll("false", "False").replaceAll("null", "None")}`;
  const curl = `curl -sf${method === "get" || body ? "" : ` -X ${verb}`}${body && verb !== "POST" ? ` -X ${verb}` : ""}${body} \\\n  ${url}`;
  const python = `import httpx\n\nfarm = "${location.origin}"\nanswer = httpx.${method}(\n    farm + "${path}"${sent},\n)\nanswer.raise_for_status()`;
  return Object.entries({ curl, Python: python }).map(([name, text]) => h("div", null, h("h3", null, name), h("pre", { tabindex: "0" }, text)));
}

function operation(path, method, about, api) {
  const parameters = (about.parameters ?? []).map((p) => row(p.name, p.schema ?? {}, p.required && p.in !== "path", api, p.description ?? (p.in === "path" ? "part of the URL" : undefined), p.in));
  const sent = Object.entries(about.requestBody?.content ?? {}).map(([media, { schema }]) => properties(`Body: ${media}`, schema, api, true) ?? "");
  const given = Object.entries(about.responses ?? {})
    .filter(([status]) => status.startsWith("2"))
    .flatMap(([status, answer]) =>
      Object.entries(answer.content ?? {}).map(([media, { schema }]) => properties(`${status}: ${media}`, schema ?? {}, api) ?? h("p", null, `${status}: ${media}`)),
    );
  const summary = h(
    "summary",
    null,
    h("code", { class: "method" }, method.toUpperCase()),
    h("code", { class: "path" }, path),
    h("span", { class: "about" }, ...withCode((about.description ?? about.summary ?? "").split("\n")[0])),
  );
  const rest = (about.description ?? "").split("\n").slice(1).join("\n").trim().split(/\n\s*\n/).filter(Boolean);
  const paragraphs = rest.map((text) => h("p", null, ...withCode(text)));
  const examples = h("div", { class: "commands" }, ...commands(path, method, about, api));
  const fields = h("div", { class: "fields" }, ...paragraphs, table("Parameters", parameters), ...sent, ...given);
  return h("details", null, summary, h("div", { class: "inside" }, examples, fields));
}

function page(api) {
  const groups = new Map();
  for (const [path, methods] of Object.entries(api.paths)) {
    for (const method of METHODS.filter((each) => methods[each])) {
      const tag = methods[method].tags?.[0] ?? "other";
      groups.set(tag, [...(groups.get(tag) ?? []), operation(path, method, methods[method], api)]);
    }
  }
  const place = ([tag]) => (FIRST.indexOf(tag) + 1 || FIRST.length + 1);
  return [...groups].sort((a, b) => place(a) - place(b)).map(([tag, operations]) => h("section", { id: anchorOf(tag) }, h("h2", null, tag), ...operations));
}

const main = document.getElementById("operations");
try {
  const answer = await fetch("/openapi.json");
  if (answer.status === 401) throw new Error("log in on the page first");
  if (!answer.ok) throw new Error(`the service answers ${answer.status}`);
  const api = await answer.json();
  const sections = page(api);
  main.replaceChildren(...sections);
  // The first one is open, as an example of what an entry has.
  const first = location.hash ? null : main.querySelector("details");
  if (first) {
    first.open = true;
    first.classList.add("example");
    first.querySelector(".fields").tabIndex = 0; // it scrolls
  }
  document.querySelector(".intro").append(h("p", { class: "quality" }, `Rayfarm ${api.info.version}`));
  document.querySelector(".sections").replaceChildren(...sections.map((each) => h("a", { href: `#${each.id}` }, each.querySelector("h2").textContent)));
} catch (error) {
  main.replaceChildren(h("p", null, `The description of the API cannot be loaded: ${error.message}. Reload the page.`));
}

document.getElementById("find").addEventListener("input", (event) => {
  const wanted = event.target.value.trim().toLowerCase();
  for (const each of main.querySelectorAll("details")) each.hidden = !each.textContent.toLowerCase().includes(wanted);
  for (const each of main.querySelectorAll("section")) each.hidden = !each.querySelector("details:not([hidden])");
  document.getElementById("none").hidden = main.querySelector("section:not([hidden])") !== null;
});

addThemeMenu();
