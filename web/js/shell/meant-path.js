/** Addresses that have no view, but are typed or guessed for one that has. */

/** Sections by other names for them. @type {Record<string, string>} */
const SECTIONS = { compare: "jobs", job: "jobs", machine: "workers", machines: "workers", scene: "scenes", worker: "workers" };
/** Sections without a list of their own, which the front page has, and names for that page. */
const FRONT = ["home", "index", "login", "scenes"];

/**
 * Returns the path that is meant by one without a view; null: unknown.
 *
 * @param {string[]} path
 * @param {(path: string[]) => boolean} hasView
 */
export function meantPath([section = "", ...ids], hasView) {
  const plain = section.toLowerCase();
  const named = Object.hasOwn(SECTIONS, plain) ? (SECTIONS[plain] ?? plain) : plain;
  const meant = [named, ...ids];
  if (hasView(meant)) return meant;
  return FRONT.includes(named) ? [] : null;
}
