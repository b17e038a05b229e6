/**
 * Translates the service's messages (errors, reasons, warnings) to the language of the page.
 *
 * The service sends an English text with its code and parameters, and web/words/service.*.json has the template of
 * each code in another language. A text without a code, as from an older worker, and a code that no catalogue has are shown in
 * English.
 */

import { language, sayings } from "./words.js";

/** @typedef {string | number | boolean | Nested | Param[]} Param */
/** @typedef {{code: string, params: Record<string, any>}} Coded of a text that is known otherwise */
/** @typedef {Coded & {text: string}} Nested a sentence within another */

/** Characters before which an inserted sentence is written without its full stop. */
const CLOSING = /^[.;:,)。；：，）]/;
const STOP = /[.。]$/;
const DEEPEST = 6;

/**
 * @param {string | null | undefined} english a sentence or more of the service
 * @param {Coded | null} [coded] its code and parameters
 * @returns {string} the translated sentence; empty without a text
 */
export function said(english, coded) {
  return (coded && language !== "en" && translated(coded, 0)) || (english ?? "");
}

/**
 * Returns a text of a record of the service, translated by the code and parameters in the record's `codes`.
 *
 * @param {any} record
 * @param {string} field
 */
export function saidOf(record, field) {
  return said(record?.[field], record?.codes?.[field]);
}

/**
 * Returns a text of a record like `saidOf`, without the cause in brackets at its end and with a full stop, and that cause: such as a
 * reader's error, which explains more to the author of a program than to its user.
 *
 * @param {any} record
 * @param {string} field
 * @returns {[text: string, cause: string]} cause: empty if the text has none
 */
export function saidApart(record, field) {
  const whole = saidOf(record, field);
  const params = record?.codes?.[field]?.params ?? {};
  const cause = params.detail ?? params.error;
  if (cause === undefined) return [whole, ""];
  const text = insertedText(cause, ")", 0);
  const end = [` (${text})`, `（${text}）`].find((each) => whole.endsWith(each));
  const rest = end ? whole.slice(0, -end.length) : "";
  return end ? [STOP.test(rest) ? rest : `${rest}${language === "zh" ? "。" : "."}`, text] : [whole, ""];
}

/**
 * Returns a list of texts of a record, translated like `saidOf`.
 *
 * @param {any} record
 * @param {string} field
 * @returns {string[]}
 */
export function allSaidOf(record, field) {
  return (record?.[field] ?? []).map((/** @type {string} */ text, /** @type {number} */ i) => said(text, record.codes?.[field]?.[i]));
}

/** @param {Coded} coded @param {number} depth @returns {string | null} null for an unknown code */
function translated({ code, params }, depth) {
  const template = sayings[code];
  if (template === undefined || depth > DEEPEST) return null;
  return template.replace(/\{(\w+)\}/g, (/** @type {string} */ place, /** @type {string} */ name, /** @type {number} */ at) => {
    const value = params?.[name];
    return value === undefined ? place : insertedText(value, template.slice(at + place.length), depth);
  });
}

/** @param {Param} value @param {string} following the rest of the template after the value @param {number} depth @returns {string} */
function insertedText(value, following, depth) {
  if (Array.isArray(value)) return value.map((each) => insertedText(each, ",", depth)).join(language === "zh" ? "、" : ", ");
  if (value === null || typeof value !== "object") return String(value);
  const text = (language !== "en" && translated(value, depth + 1)) || value.text;
  return CLOSING.test(following) ? text.replace(STOP, "") : text;
}
