/** Keyboard shortcuts: each view registers its own with a description, and `?` lists the active ones in groups. */

/**
 * @typedef {object} Shortcut
 * @property {string} keys "E", "Shift+E", "Enter"; "": none, the command palette alone has it
 * @property {string} does
 * @property {string | null} [shown] in the help instead of the keys; null leaves it out
 * @property {() => void} run
 */

/** The subject of a shortcut: the view of a picture, the picture or its job, or the page. @typedef {"view" | "picture" | "page"} Group */

/** @type {Map<Shortcut, Group>} */
const active = new Map();

/** "off" disables shortcuts of a single letter, since dictation types letters (WCAG 2.2, 2.1.4). */
const LETTERS_KEY = "rayfarm.letters";

/** Whether shortcuts of a single letter are enabled. */
export function hasLetterShortcuts() {
  try {
    return localStorage.getItem(LETTERS_KEY) !== "off";
  } catch {
    return true; // storage is blocked
  }
}

/** @param {boolean} act */
export function setLetterShortcuts(act) {
  try {
    if (act) localStorage.removeItem(LETTERS_KEY);
    else localStorage.setItem(LETTERS_KEY, "off");
  } catch {
    // Storage is blocked: they stay enabled.
  }
}

/**
 * @param {Shortcut[]} shortcuts
 * @param {Group} [group]
 * @returns {() => void} removes them
 */
export function addShortcuts(shortcuts, group = "page") {
  for (const shortcut of shortcuts) active.set(shortcut, group);
  return () => {
    for (const shortcut of shortcuts) active.delete(shortcut);
  };
}

/** @returns {(Shortcut & {group: Group})[]} */
export function shortcuts() {
  return [...active].map(([shortcut, group]) => ({ ...shortcut, group }));
}

/**
 * Returns the name of a key event, such as "Shift+E". Characters that require Shift ("?", "+") are named without it.
 *
 * @param {KeyboardEvent} event
 */
function nameOf(event) {
  const letter = /^[a-z]$/i.test(event.key);
  const key = letter ? event.key.toUpperCase() : event.key === " " ? "Space" : event.key;
  return event.shiftKey && (letter || key.length > 1) ? `Shift+${key}` : key;
}

/** @param {EventTarget | null} target */
function isTyping(target) {
  return (
    target instanceof HTMLElement &&
    target.matches("input:not([type=range], [type=checkbox], [type=radio]), textarea, select, option, [contenteditable]")
  );
}

const MOVED = "input[type=range], input[type=radio], [role=slider]";

/** @param {KeyboardEvent} event */
function dispatch(event) {
  if (event.ctrlKey || event.metaKey || event.altKey || event.defaultPrevented || isTyping(event.target)) return;
  if (document.querySelector("dialog[open]")) return;
  const name = nameOf(event);
  if (event.key.length === 1 && event.key !== " " && !hasLetterShortcuts()) return;
  // Enter and Space belong to the focused button or link.
  if (
    (name === "Enter" || name === "Space") &&
    event.target instanceof HTMLElement &&
    event.target.matches("button, a, summary, input")
  )
    return;
  // Arrow keys belong to focused controls that they move.
  if (/^(Shift\+)?(Arrow|Home|End)/.test(name) && event.target instanceof HTMLElement && event.target.matches(MOVED)) return;
  // What a digit key types depends on the keyboard, and on French ones a digit needs Shift.
  const digit = /^Digit\d$/.test(event.code) ? `${event.shiftKey ? "Shift+" : ""}${event.code.slice(5)}` : name;
  const all = [...active.keys()];
  const found = all.findLast(({ keys }) => keys === digit) ?? all.findLast(({ keys }) => keys === name);
  if (!found) return;
  event.preventDefault();
  found.run();
}

addEventListener("keydown", dispatch);
