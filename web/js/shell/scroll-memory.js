/** The scroll position of each history entry: the back button restores it, a link starts at the top. */

const PATIENCE_MS = 1500; // waits for content of the service that makes the page long enough again

/** Scroll positions, by history entry. @type {Map<number, number>} */
const tops = new Map();
/** Scroll positions of the latest entry of each address. @type {Map<string, number>} */
const latestTops = new Map();
/** Whether the next address is followed by a link back, so that the page starts where it was. */
let isReturn = false;
let newest = Date.now(); // greater than the entries of this tab before a reload
let entry = newest;
let address = "";
let waiting = 0;

/** Starts recording positions. */
export function followScroll() {
  history.scrollRestoration = "manual";
  addEventListener("scroll", () => waiting || remember(), { passive: true });
  for (const hand of ["wheel", "touchmove", "keydown", "pointerdown"]) addEventListener(hand, giveUp, { passive: true });
}

function remember() {
  tops.set(entry, scrollY);
  latestTops.set(address, scrollY);
}

/** Makes the next page start at the scroll position that it had, since a link back to it is followed. */
export const returnToPlace = () => void (isReturn = true);

/** Restores the scroll position of the current entry once its view is shown; a new entry starts at the top. */
export function scrollToPlace() {
  giveUp();
  entry = history.state?.entry ?? ++newest;
  history.replaceState({ ...history.state, entry }, "");
  address = location.hash.split("?")[0] ?? "";
  const top = tops.get(entry) ?? (isReturn ? latestTops.get(address) : 0) ?? 0;
  isReturn = false;
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
