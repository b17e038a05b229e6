/** The scroll position of each history entry: the back button restores it, a link starts at the top. */

const PATIENCE_MS = 1500; // waits for content of the service that makes the page long enough again

/** Scroll positions, by history entry. @type {Map<number, number>} */
const tops = new Map();
let newest = Date.now(); // greater than the entries of this tab before a reload
let entry = newest;
let waiting = 0;

/** Starts recording positions. */
export function followScroll() {
  history.scrollRestoration = "manual";
  addEventListener("scroll", () => waiting || tops.set(entry, scrollY), { passive: true });
  for (const hand of ["wheel", "touchmove", "keydown", "pointerdown"]) addEventListener(hand, giveUp, { passive: true });
}

/** Restores the scroll position of the current entry once its view is shown; a new entry starts at the top. */
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

/** Manual scrolling cancels it. */
function giveUp() {
  cancelAnimationFrame(waiting);
  waiting = 0;
}
