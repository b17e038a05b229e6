// Runs function bodies with a module of the page: a line of JSON {module, body, argument} in, a line {value} or {error} out.
// What modules ask a browser for as they are loaded stands here; none of it draws.

import { readFile } from "node:fs/promises";
import { createInterface } from "node:readline";

const [web, locale] = process.argv.slice(2);
const events = new EventTarget();
for (const name of ["addEventListener", "removeEventListener", "dispatchEvent"]) globalThis[name] = events[name].bind(events);
globalThis.KeyboardEvent = class extends Event {
  constructor(type, { key, code = "", shiftKey = false }) {
    super(type);
    Object.assign(this, { key, code, shiftKey });
  }
};
globalThis.HTMLElement = class {};
const nothing = () => null;
globalThis.document = { documentElement: {}, getElementById: nothing, querySelector: nothing, addEventListener() {} };
const kept = new Map();
globalThis.localStorage = {
  getItem: (key) => kept.get(key) ?? null,
  setItem: (key, value) => kept.set(key, value),
  removeItem: (key) => kept.delete(key),
};
globalThis.location = new URL("http://127.0.0.1/");
Object.defineProperty(globalThis, "navigator", { value: { language: locale, languages: [locale] }, configurable: true });
globalThis.fetch = async (url) => new Response(await readFile(url)); // catalogues of words, beside the modules

const AsyncFunction = (async () => {}).constructor;
for await (const line of createInterface({ input: process.stdin })) {
  const { module, body, argument } = JSON.parse(line);
  let answer;
  try {
    const m = await import(`${web}/js/${module}.js`);
    const read = (path) => import(`${web}${path}`);
    answer = { value: (await new AsyncFunction("m", "a", "read", body)(m, argument, read)) ?? null };
  } catch (error) {
    answer = { error: String(error?.stack ?? error) };
  }
  process.stdout.write(`${JSON.stringify(answer)}\n`);
}
