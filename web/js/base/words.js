/**
 * The page's texts in the language of whoever reads it. The English text is the key: what a catalogue in `web/words/` lacks is
 * shown in English. Whoever imports this waits until the catalogue is there, so constants may be translated too.
 */

/** What the page is written in, each language under its own name. */
export const LANGUAGES = /** @type {const} */ ([
  ["en", "English"],
  ["de", "Deutsch"],
  ["zh", "中文"],
]);

/** @typedef {(typeof LANGUAGES)[number][0]} Language */

const KEY = "rayfarm.language";
/** Chinese is written here in the simplified script. */
const TAGS = { en: "en", de: "de", zh: "zh-Hans" };

/** The language of the page. */
export const language = chosen();

const [catalogue, spoken] = language === "en" ? [{}, {}] : await Promise.all([load(language), load(`service.${language}`)]);
/** Sentences of the service, as ./said.js puts them together. */
export const sayings = spoken;
const plurals = new Intl.PluralRules(language);
/** Everywhere on the page a point begins the decimals. Where people are used to a comma there, it may not part thousands. */
const parting = (1.5).toLocaleString(language).includes(",") ? "\u202f" : ",";
if (globalThis.document) document.documentElement.lang = TAGS[language];

/** @returns {Language} what the user chose, else the first of the browser's languages that the page is written in */
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

/** @param {string} name @returns {Promise<Record<string, string>>} empty where it cannot be had: English is better than no page */
async function load(name) {
  try {
    const response = await fetch(new URL(`../../words/${name}.json`, import.meta.url));
    return response.ok ? await response.json() : {};
  } catch {
    return {};
  }
}

/** Shows the page in another language, from now on. @param {Language} next */
export function speak(next) {
  try {
    localStorage.setItem(KEY, next);
  } catch {
    // Storage is blocked: the browser's own language stays.
  }
  location.reload();
}

/**
 * A text in the language of the page.
 *
 * @param {string} english `{name}` are places for values
 * @param {Record<string, string | number>} [values]
 */
export function t(english, values) {
  const text = catalogue[english] ?? english;
  return values ? text.replace(/\{(\w+)\}/g, (place, name) => String(values[name] ?? place)) : text;
}

/**
 * A whole number with separators of thousands: 1,234,567.
 *
 * @param {number} n
 */
export function grouped(n) {
  return n.toLocaleString("en").replaceAll(",", parting);
}

/**
 * A text that counts: "1 sample", "2 samples".
 *
 * @param {number} n `{n}` in the text, with separators of thousands
 * @param {string} one of a single one
 * @param {string} many of any other number
 * @param {Record<string, string | number>} [values]
 */
export function tn(n, one, many, values) {
  return t(plurals.select(n) === "one" ? one : many, { n: grouped(n), ...values });
}
