/**
 * The page's texts in the user's language. The English text is the key; texts missing from a catalogue in `web/words/` are shown
 * in English. Importing this module waits for the catalogue, so constants may be translated too.
 */

/** Languages of the page, each with its own name. */
export const LANGUAGES = /** @type {const} */ ([
  ["en", "English"],
  ["de", "Deutsch"],
  ["zh", "中文"],
]);

/** @typedef {(typeof LANGUAGES)[number][0]} Language */

const KEY = "rayfarm.language";
/** The catalogue's Chinese uses the simplified script. */
const TAGS = { en: "en", de: "de", zh: "zh-Hans" };

/** The language of the page. */
export const language = chosen();

const [catalogue, spoken] = language === "en" ? [{}, {}] : await Promise.all([load(language), load(`service.${language}`)]);
/** Translations of the service's messages, used by ./said.js. */
export const sayings = spoken;
const plurals = new Intl.PluralRules(language);
/** The page uses a decimal point everywhere. In locales with a decimal comma, a comma must not separate thousands. */
const parting = (1.5).toLocaleString(language).includes(",") ? "\u202f" : ",";
if (globalThis.document) document.documentElement.lang = TAGS[language];

/** @returns {Language} the user's choice, else the first supported language of the browser */
function chosen() {
  const names = LANGUAGES.map(([name]) => name);
  /** @type {(string | null)[]} */
  const wanted = [stored(), ...navigator.languages];
  for (const tag of wanted) {
    const found = names.find((name) => name === tag?.toLowerCase().split("-", 1)[0]);
    if (found) return found;
  }
  return "en";
}

/** @returns {string | null} */
function stored() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // storage is blocked
  }
}

/** @param {string} name @returns {Promise<Record<string, string>>} empty if it cannot be loaded; the page is then in English */
async function load(name) {
  try {
    const response = await fetch(new URL(`../../words/${name}.json`, import.meta.url));
    return response.ok ? await response.json() : {};
  } catch {
    return {};
  }
}

/** Switches the page to another language. @param {Language} next */
export function speak(next) {
  try {
    localStorage.setItem(KEY, next);
  } catch {
    // Storage is blocked: the browser's own language stays.
  }
  location.reload();
}

/**
 * Translates a text to the language of the page.
 *
 * @param {string} english `{name}` are places for values
 * @param {Record<string, string | number>} [values]
 */
export function t(english, values) {
  const text = catalogue[english] ?? english;
  return values ? text.replace(/\{(\w+)\}/g, (place, name) => String(values[name] ?? place)) : text;
}

/**
 * A whole number with thousands separators: 1,234,567.
 *
 * @param {number} n
 */
export function grouped(n) {
  return n.toLocaleString("en").replaceAll(",", parting);
}

/**
 * Translates a text with a count: "1 sample", "2 samples".
 *
 * @param {number} n `{n}` in the text, with separators of thousands
 * @param {string} one of a single one
 * @param {string} many of any other number
 * @param {Record<string, string | number>} [values]
 */
export function tn(n, one, many, values) {
  return t(plurals.select(n) === "one" ? one : many, { n: grouped(n), ...values });
}
