/** Creates DOM elements without markup strings, so that user input and file names are always text, never HTML. */

/** @typedef {Node | string | number | null | undefined | false} Child */

/**
 * An element with properties and children. `on…` properties are listeners; a property that the element knows is set as such
 * (value, checked, hidden …), everything else as an attribute; null, undefined and false leave an attribute out.
 *
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag
 * @param {Record<string, any> | null} [props]
 * @param {...(Child | Child[])} children
 * @returns {HTMLElementTagNameMap[K]}
 */
export function h(tag, props, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(props ?? {})) setProperty(element, name, value);
  append(element, children);
  return element;
}

/**
 * @param {HTMLElement} element
 * @param {string} name
 * @param {any} value
 */
function setProperty(element, name, value) {
  if (name.startsWith("on")) {
    element.addEventListener(name.slice(2), value);
  } else if (name === "class") {
    element.className = value;
  } else if (!name.includes("-") && name in element && typeof value !== "string" && value != null) {
    /** @type {any} */ (element)[name] = value;
  } else if (value != null && value !== false) {
    element.setAttribute(name, value === true ? "" : String(value));
  }
}

/**
 * @param {Node} parent
 * @param {(Child | Child[])[]} children
 */
export function append(parent, children) {
  for (const child of children.flat()) {
    if (child == null || child === false) continue;
    parent.appendChild(child instanceof Node ? child : document.createTextNode(String(child)));
  }
}

/**
 * Replaces an element's children.
 *
 * @param {Element} element
 * @param {...(Child | Child[])} children
 */
export function fill(element, ...children) {
  element.textContent = "";
  append(element, children);
}

/**
 * Shows short facts in a row, with dots between those on one line (the class `facts-line`).
 *
 * @param {HTMLElement} element
 * @param {string[]} facts
 */
export function setFacts(element, facts) {
  const text = facts.join("\n");
  if (element.dataset.facts === text) return;
  element.dataset.facts = text;
  fill(element, facts.map((fact) => h("span", null, fact)));
}

/**
 * Sets an element's text if it differs, since screen readers repeat text that is written again.
 *
 * @param {Element} element
 * @param {string | number} text
 */
export function setText(element, text) {
  if (element.textContent !== String(text)) element.textContent = String(text);
}

/**
 * @template T
 * @typedef {object} Row  One element of a list that stays in place while its item changes.
 * @property {HTMLElement} element
 * @property {(item: T) => void} update
 */

/** @param {Element | null | undefined} element a row of a list */
export function focusRow(element) {
  /** @type {HTMLElement | null | undefined} */ (element?.querySelector("a, button"))?.focus({ preventScroll: true });
}

/**
 * Keeps a container's children in step with a list of items. Rows are reused by key, so focus and running transitions survive
 * changes. The focus of a removed row moves to its successor.
 *
 * @template T
 * @param {Element} container
 * @param {(item: T) => string} key
 * @param {(item: T) => Row<T>} create
 * @returns {(items: T[]) => void}
 */
export function keyedList(container, key, create) {
  /** @type {Map<string, Row<T>>} */
  let rows = new Map();
  return (items) => {
    /** @type {typeof rows} */
    const next = new Map();
    for (const item of items) {
      const id = key(item);
      const row = rows.get(id) ?? create(item);
      row.update(item);
      next.set(id, row);
    }
    const place = [...rows.values()].findIndex(({ element }) => element.contains(document.activeElement));
    for (const [id, row] of rows) if (!next.has(id)) row.element.remove();
    const lost = place >= 0 && document.activeElement === document.body;
    let at = container.firstElementChild;
    for (const row of next.values()) {
      if (row.element === at) at = at.nextElementSibling;
      else container.insertBefore(row.element, at);
    }
    rows = next;
    if (lost) focusRow([...next.values()].at(Math.min(place, next.size - 1))?.element);
  };
}
