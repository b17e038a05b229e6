/** The others who look at the scene at the same time: their names, their cursors on the same view, and following one's camera. */

import { h } from "../base/dom.js";
import { session } from "../news/session.js";
import { announce } from "../shell/tray.js";
import { isSameView } from "./orbit.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").View} View */
/**
 * @typedef {object} Person
 * @property {number} id
 * @property {string | null} name null: unknown
 * @property {[number, number] | null} cursor from the picture's centre, in heights of the picture
 * @property {View | null} view
 */

/** Name of someone on a farm without logins, as it is remembered for notes. */
const KEY = "rayfarm.author";
const SEND_MS = 100;
const COLOURS = ["#f5a83b", "#4aa8ff", "#5fd38a", "#ff7d9c", "#b88cff", "#38c6c6"];

/**
 * @param {HTMLElement} surface the view, over which cursors are shown
 * @param {object} parts
 * @param {() => View} parts.view the own camera
 * @param {(message: Record<string, any>) => void} parts.send
 * @param {(view: View) => void} parts.turnTo shows a view that another person has
 */
export function people(surface, { view, send, turnTo }) {
  const list = h("div", { class: "view-people", role: "group", "aria-label": t("People in this view") });
  const layer = h("div", { class: "view-cursors", "aria-hidden": "true" });
  surface.append(layer);
  /** @type {Person[]} */
  let others = [];
  /** Id of the followed person. @type {number | null} */
  let followed = null;
  /** @type {[number, number] | null} */
  let cursor = null;
  let sent = "";
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let waiting;

  const tell = () => {
    waiting = undefined;
    const presence = { name: ownName(), cursor: others.length ? cursor : null, view: view() };
    const text = JSON.stringify(presence);
    if (text === sent) return;
    sent = text;
    send({ presence });
  };
  const soon = () => void (waiting ??= setTimeout(tell, SEND_MS));

  const nameOf = (/** @type {Person} */ { id, name }) => name ?? t("Guest {n}", { n: id });
  const colourOf = (/** @type {Person} */ { id }) => COLOURS[id % COLOURS.length] ?? "";
  const follow = (/** @type {number | null} */ id) => {
    followed = id;
    const person = others.find((each) => each.id === id);
    if (person) announce(t("Following {name}. Move the view to stop.", { name: nameOf(person) }));
    if (person?.view) turnTo(person.view);
    show();
  };
  const place = () => {
    const { clientWidth, clientHeight } = surface;
    const mine = view();
    const marks = others.flatMap((person) => {
      if (!person.cursor || !person.view || !isSameView(person.view, mine)) return [];
      const mark = h("span", { class: "view-cursor" }, nameOf(person));
      mark.style.setProperty("--person", colourOf(person));
      mark.style.translate = `${clientWidth / 2 + person.cursor[0] * clientHeight}px ${clientHeight / 2 + person.cursor[1] * clientHeight}px`;
      return [mark];
    });
    layer.replaceChildren(...marks);
  };
  let listed = "";
  const show = () => {
    place();
    const key = JSON.stringify([followed, others.map(({ id, name }) => [id, name])]);
    if (key === listed) return;
    listed = key;
    const hadFocus = [...list.children].indexOf(/** @type {Element} */ (document.activeElement));
    list.replaceChildren(
      ...others.map((person) => {
        const label = person.id === followed ? t("Following {name}", { name: nameOf(person) }) : t("Follow {name}", { name: nameOf(person) });
        const chip = h("button", { class: "view-person", type: "button", "aria-pressed": String(person.id === followed), title: label, "aria-label": label, onclick: () => follow(person.id === followed ? null : person.id) }, nameOf(person));
        chip.style.setProperty("--person", colourOf(person));
        return chip;
      }),
    );
    /** @type {HTMLElement | undefined} */ (list.children[hadFocus])?.focus({ preventScroll: true });
    list.hidden = others.length === 0;
  };

  const moved = (/** @type {PointerEvent} */ event) => {
    const box = surface.getBoundingClientRect();
    cursor = event.type === "pointerleave" ? null : [(event.clientX - box.left - box.width / 2) / box.height, (event.clientY - box.top - box.height / 2) / box.height];
    if (others.length) soon();
  };
  surface.addEventListener("pointermove", moved);
  surface.addEventListener("pointerleave", moved);
  list.hidden = true;
  return {
    element: list,
    /** @param {Person[]} next */
    take(next) {
      const isFirst = others.length === 0 && next.length > 0;
      others = next;
      if (followed !== null && !others.some(({ id }) => id === followed)) followed = null;
      const leader = others.find(({ id }) => id === followed);
      if (leader?.view && !isSameView(leader.view, view())) turnTo(leader.view);
      show();
      if (isFirst) soon();
    },
    /** Shows others the own view after it was changed. */
    changed() {
      place();
      soon();
    },
    /** Stops following, since the user moves the view. */
    stop() {
      if (followed === null) return;
      followed = null;
      show();
    },
    /** Introduces the user again after the connection was lost. */
    renew() {
      sent = "";
      soon();
    },
    dispose: () => clearTimeout(waiting),
  };
}

/** @returns {string | null} the typed name on a farm without logins */
function ownName() {
  if (session.value.kind !== "open") return null; // the service knows it
  try {
    return localStorage.getItem(KEY) || null;
  } catch {
    return null; // storage is blocked
  }
}
