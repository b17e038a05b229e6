/**
 * Translates the service's messages (errors, reasons, warnings) to the language of the page.
 *
 * The messages come from workers, file readers, databases and older releases as English text, which programs get as well. So the
 * text itself is the key, as with the page's own texts, with placeholders for the variable parts. Several sentences are
 * translated one by one, and so are quoted sentences; text without a translation stays English.
 */

import { language, sayings } from "./words.js";

/**
 * A sentence with placeholders: the text between them, and their names.
 * @typedef {{parts: string[], names: string[], text: string}} Pattern
 */

/** Longer messages are traces of programs. */
const LONGEST = 4000;
const DEEPEST = 5;
/** Number of cached translations, since lists show the same messages repeatedly. */
const MOST_KEPT = 500;
const PLACE = /\{(\w+)\}/;
/** Boundary between sentences. Names and numbers contain points too, so the next sentence must start with a capital letter. */
const BETWEEN = /(?<=[.!?]) (?=[\p{Lu}`])/u;

/** @type {Pattern[] | null} */
let patterns = null;
/** @type {Map<string, string>} */
const kept = new Map();

/**
 * @param {string | null | undefined} english one or more sentences of the service
 * @returns {string} the translation; empty for no message
 */
export function said(english) {
  if (!english || language === "en" || english.length > LONGEST) return english ?? "";
  const known = kept.get(english);
  if (known !== undefined) return known;
  if (kept.size >= MOST_KEPT) kept.clear();
  const found = translated(english, 0) ?? english;
  kept.set(english, found);
  return found;
}

/** @param {string} text @param {number} depth @returns {string | null} null if no part of it can be translated */
function translated(text, depth) {
  if (depth > DEEPEST) return null;
  return sayings[text] ?? oneByOne(text, depth) ?? whole(text, depth) ?? counted(text, depth) ?? repeated(text, depth) ?? halves(text, depth) ?? afterName(text, depth);
}

/**
 * Translates a file reader's summary of many items: "problem (count): first items".
 * @param {string} text
 * @param {number} depth
 */
function counted(text, depth) {
  const [, what, n, names, others] = /^([^:]+) \((\d+)\): (.+?)( and others)?\.$/s.exec(text) ?? [];
  const found = what === undefined ? null : translated(what, depth + 1);
  return found === null ? null : `${found} (${n}): ${names}${others ? (sayings[others] ?? others) : ""}${language === "zh" ? "。" : "."}`;
}

/** @param {string} text @param {number} depth */
function repeated(text, depth) {
  const [, what, n] = /^(.+) \((\d+) times\)$/s.exec(text) ?? [];
  const found = what === undefined ? null : translated(what, depth + 1);
  return found === null ? null : found + (sayings[" ({n} times)"] ?? " ({n} times)").replace("{n}", n ?? "");
}

/** Translates amounts with their names, some of which contain a comma: "2 skins, 1 camera". @param {string} text */
function amounts(text) {
  if (!/^\d+ /.test(text)) return null;
  return text
    .split(/, (?=\d+ )/)
    .map((each) => each.replace(/^(\d+ )(.+)$/s, (_, n, what) => n + (sayings[what] ?? what)))
    .join(", ");
}

/** @param {string} text @param {number} depth */
function whole(text, depth) {
  for (const { parts, names, text: template } of (patterns ??= compiled())) {
    const values = between(parts, text);
    if (values) return template.replaceAll(/\{(\w+)\}/g, (place, name) => quoted(values[names.indexOf(name)] ?? place, depth));
  }
  return null;
}

/** @returns {Pattern[]} the most specific ones first */
function compiled() {
  const found = Object.entries(sayings).flatMap(([english, text]) => {
    const pieces = english.split(PLACE);
    const parts = pieces.filter((_, i) => i % 2 === 0);
    return parts.length > 1 ? [{ parts, names: pieces.filter((_, i) => i % 2 === 1), text }] : [];
  });
  const length = (/** @type {Pattern} */ { parts }) => parts.join("").length;
  return found.sort((a, b) => length(b) - length(a));
}

/**
 * @param {string[]} parts @param {string} text
 * @returns {string[] | null} the text between the parts, if they occur in this order
 */
function between(parts, text) {
  const last = parts.length - 1;
  const begin = parts[0] ?? "";
  const end = text.length - (parts[last] ?? "").length;
  if (!text.startsWith(begin) || !text.endsWith(parts[last] ?? "")) return null;
  const values = [];
  let at = begin.length;
  for (const part of parts.slice(1, last)) {
    const found = text.indexOf(part, at);
    if (found < 0) return null;
    values.push(text.slice(at, found));
    at = found + part.length;
  }
  if (at > end) return null;
  values.push(text.slice(at, end));
  // The sentence starts with a name; a name before that is handled by `afterName`.
  return values.every(Boolean) && (begin || !values[0]?.includes(": ")) ? values : null;
}

/**
 * Translates a quotation: usually a name, sometimes a sentence without its capital letter or full stop.
 * @param {string} value
 * @param {number} depth
 */
function quoted(value, depth) {
  const capital = value.charAt(0).toUpperCase() + value.slice(1);
  const sentence = () => (value.includes(" ") ? translated(`${capital}.`, depth + 1)?.replace(/[.。]$/, "") : undefined);
  return sayings[value] ?? sayings[capital] ?? amounts(value) ?? (value.includes(" ") ? translated(value, depth + 1) : null) ?? sentence() ?? value;
}

/** @param {string} text @param {number} depth */
function oneByOne(text, depth) {
  const sentences = text.split(BETWEEN);
  if (sentences.length < 2) return null;
  const found = sentences.map((sentence) => translated(sentence, depth + 1));
  if (found.every((each) => each === null)) return null;
  return found.map((each, i) => each ?? sentences[i]).join(language === "zh" ? "" : " ");
}

/** Translates a refusal of a file: "problem; remedy". @param {string} text @param {number} depth */
function halves(text, depth) {
  const at = text.lastIndexOf("; ");
  if (at < 0) return null;
  const [wrong, remedy] = [text.slice(0, at), text.slice(at + 2)];
  const [first, second] = [translated(wrong, depth + 1), translated(remedy, depth + 1)];
  if (first === null && second === null) return null;
  return `${first ?? wrong}${language === "zh" ? "；" : "; "}${second ?? remedy}`;
}

/** Translates an error of a file or field: "name: problem". @param {string} text @param {number} depth */
function afterName(text, depth) {
  const [, name, rest] = /^([^:]{1,120}): (.+)$/s.exec(text) ?? [];
  const found = rest === undefined ? null : translated(rest, depth + 1) ?? withoutPoint(rest, depth + 1);
  return found === null ? null : `${name}: ${found}`;
}

/** @param {string} text @param {number} depth */
function withoutPoint(text, depth) {
  const found = text.endsWith(".") ? translated(text.slice(0, -1), depth) : null;
  return found === null ? null : `${found}${language === "zh" ? "。" : "."}`;
}
