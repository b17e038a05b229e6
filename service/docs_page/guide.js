/** The guides: search, copy buttons, the theme, a note on the language, and the section that is being read. */

import { h } from "/js/base/dom.js";
import { addThemeMenu } from "./theme-menu.js";

/** @typedef {{guide: string, title: string, anchor: string, heading: string, text: string}} Section */

const MOST_FOUND = 12;
const EXCERPT = 90;
/** The guides are written in English. */
const NOTES = {
  de: "Diese Anleitung gibt es bisher nur auf Englisch.",
  zh: "这篇指南目前只有英文版。",
};

/** Adds a button that copies it to each block of code. */
function addCopyButtons() {
  if (!navigator.clipboard) return; // pages on http from another machine
  for (const block of document.querySelectorAll("main pre")) {
    const button = h("button", { type: "button", class: "copy" }, "Copy");
    button.addEventListener("click", async () => {
      await navigator.clipboard.writeText(block.textContent ?? "");
      button.textContent = "Copied";
      setTimeout(() => (button.textContent = "Copy"), 1500);
    });
    const frame = h("div", { class: "code" });
    block.replaceWith(frame);
    frame.append(block, button);
  }
}

/** Puts each line of code into an element, which narrow screens break with a hanging indent. Lines of comments are
 *  quiet. Diagrams stay as they are. */
function splitLines() {
  for (const code of document.querySelectorAll("main pre code")) {
    const text = code.textContent ?? "";
    if (/[─│]/.test(text)) continue;
    const lines = text.split(/(?<=\n)/);
    const kind = (line) => (/^\s*#/.test(line) ? "line comment" : "line");
    code.replaceChildren(...lines.map((line) => h("span", { class: kind(line) }, line)));
  }
}

/** Says in the reader's language that the guides are in English; `rayfarm.language` is the choice made on the page. */
function addLanguageNote() {
  let chosen = null;
  try {
    chosen = localStorage.getItem("rayfarm.language");
  } catch {
    // Storage is blocked: the browser's languages decide.
  }
  const language = [chosen, ...navigator.languages].filter(Boolean).map((name) => name.slice(0, 2))
    .find((name) => name === "en" || name in NOTES);
  const note = document.querySelector(".language");
  const own = document.documentElement.lang;
  const translated = document.querySelector(`.translations [hreflang="${language}"]`);
  if (!note || !language || !(language in NOTES) || language === own || translated) return;
  note.textContent = NOTES[language];
  note.lang = language;
  note.hidden = false;
}

/** Folds the lists of guides and sections on narrow screens, where they come before the text. */
function foldLists() {
  for (const [name, width] of [[".side .folding", 800], [".contents .folding", 1240]]) {
    const wide = matchMedia(`(min-width: ${width}px)`);
    const list = document.querySelector(name);
    const follow = () => list && (list.open = wide.matches);
    wide.addEventListener("change", follow);
    follow();
  }
}

/** Scrolls the list of guides to the current one, without scrolling the page. */
function showCurrentGuide() {
  const side = document.querySelector(".side");
  const current = side?.querySelector("[aria-current]");
  if (side && current) side.scrollTop = current.offsetTop - side.clientHeight / 2;
}

/** Marks the section that is being read in the list of sections. */
function markSection() {
  const links = new Map([...document.querySelectorAll(".contents a")].map((link) => [link.hash.slice(1), link]));
  const headings = [...document.querySelectorAll("main h2[id]")];
  const mark = () => {
    const read = headings.findLast((heading) => heading.getBoundingClientRect().top < 120) ?? headings[0];
    for (const [anchor, link] of links) link.toggleAttribute("data-read", anchor === read?.id);
  };
  addEventListener("scroll", mark, { passive: true });
  mark();
}

/** Leads from a section that is on another page by now, or a page of its own, to that page. A page whose name begins with this
 *  one's comes first: old links have the old page's name. */
async function findMovedSection() {
  const anchor = decodeURIComponent(location.hash.slice(1));
  if (!anchor || document.getElementById(anchor)) return;
  const sections = await fetchSections().catch(() => []);
  const found = sections.filter((section) => section.anchor === anchor);
  const name = location.pathname.split("/").pop() ?? "";
  const own = found.find((section) => section.guide.startsWith(`${name}-`));
  const pages = new Set(sections.map((section) => section.guide));
  const targets = [own && `${own.guide}#${anchor}`, `${name}-${anchor}`, found[0] && `${found[0].guide}#${anchor}`, anchor];
  const target = targets.find((each) => each && (each.includes("#") || pages.has(each)));
  if (target) location.replace(target);
}

/** Fetches the text of all guides. @returns {Promise<Section[]>} */
function fetchSections() {
  return fetch("/docs/guides/search.json").then((answer) => answer.json());
}

/** Finds sections that have all words, those with them in their heading first. @param {Section[]} sections */
function matches(sections, words) {
  const found = [];
  for (const section of sections) {
    const heading = `${section.heading} ${section.title}`.toLowerCase();
    const text = section.text.toLowerCase();
    if (!words.every((word) => heading.includes(word) || text.includes(word))) continue;
    found.push({ section, rank: words.filter((word) => heading.includes(word)).length });
  }
  return found.sort((a, b) => b.rank - a.rank).map(({ section }) => section);
}

/** Returns the text around the first word that it contains. */
function excerpt(text, words) {
  const at = Math.max(0, Math.min(...words.map((word) => text.toLowerCase().indexOf(word)).filter((i) => i >= 0), text.length));
  const begin = at > EXCERPT / 3 && at < text.length ? text.lastIndexOf(" ", at - EXCERPT / 3) + 1 : 0;
  const isWhole = begin + EXCERPT >= text.length;
  const end = isWhole ? text.length : Math.max(text.lastIndexOf(" ", begin + EXCERPT), begin + EXCERPT / 2); // of a word
  return (begin ? "… " : "") + text.slice(begin, end) + (isWhole ? "" : " …");
}

/** Searches all guides while the reader types. The text of the guides is fetched at the first letter. */
function addSearch() {
  const input = document.querySelector("#find");
  const list = document.querySelector("#found");
  if (!input || !list) return;
  /** @type {Promise<Section[]> | null} */
  let sections = null;
  input.hidden = false;
  input.addEventListener("input", async () => {
    const words = input.value.toLowerCase().split(/\s+/).filter(Boolean);
    document.body.classList.toggle("finding", words.length > 0);
    list.hidden = words.length === 0;
    if (!words.length) return;
    sections ??= fetchSections();
    const typed = input.value;
    let all;
    try {
      all = await sections;
    } catch {
      sections = null;
      list.replaceChildren(h("li", { class: "none" }, "The farm does not answer."));
      return;
    }
    if (typed !== input.value) return;
    const found = matches(all, words);
    const items = found.slice(0, MOST_FOUND).map((section) =>
      h("li", null, h("a", { href: section.guide + (section.anchor && `#${section.anchor}`) },
        h("strong", null, section.heading),
        h("span", { class: "from" }, section.heading === section.title ? "" : section.title),
        h("span", { class: "about" }, excerpt(section.text, words)))));
    list.replaceChildren(...(items.length ? items : [h("li", { class: "none" }, `Nothing found for “${typed}”.`)]));
  });
  input.addEventListener("keydown", (event) => {
    if (event.key === "Enter") list.querySelector("a")?.click();
  });
  list.addEventListener("click", (event) => {
    if (!/** @type {Element} */ (event.target).closest("a")) return;
    input.value = "";
    list.hidden = true;
    document.body.classList.remove("finding");
  });
  addEventListener("keydown", (event) => {
    const target = /** @type {Element} */ (event.target);
    if (event.key !== "/" || event.ctrlKey || event.metaKey || target.closest("input, select, textarea")) return;
    event.preventDefault();
    input.focus();
  });
}

splitLines();
addCopyButtons();
addThemeMenu();
addLanguageNote();
foldLists();
showCurrentGuide();
markSection();
addSearch();
findMovedSection();
