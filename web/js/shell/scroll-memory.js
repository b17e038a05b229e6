/** How far a view was scrolled, for each entry of the history: the back button leads to where one was, a link to the top. */

const PATIENCE_MS = 1500; // with what comes from the service and makes the page long enough again

/** By entry. @type {Map<number, number>} */
const tops = new Map();
let newest = Date.now(); // above the entries of this tab before a reload
let entry = newest;
let waiting = 0;

/** Begins to follow. */
export function followScroll() {
  history.scrollRestoration = "manual";
  addEventListener("scroll", () => waiting || tops.set(entry, scrollY), { passive: true });
  for (const hand of ["wheel", "touchmove", "keydown", "pointerdown"]) addEventListener(hand, giveUp, { passive: true });
}

/** Once the view of the present entry stands: to where it was left, or to its top where it is a new one. */
export function scrollToPlace() {
  giveUp();
  entry = history.state?.entry ?? ++newest;
  history.replaceState({ ...history.state, entry }, "");
  const top = tops.get(entry) ?? 0;
  const until = performance.now() + PATIENCE_MS;
  const reach = () => {
    waiting = 0;
    scrollTo(0, top);
    if (scrollY < top - 1 && performance.now() < until) waiting = requestAnimationFrame(reach);
  };
  reach();
}

/** Whoever scrolls by hand is not pulled away. */
function giveUp() {
  cancelAnimationFrame(waiting);
  waiting = 0;
}
