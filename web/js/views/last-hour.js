/** A bar chart of a machine's speed in each minute of the last hour. */

import { setText } from "../base/dom.js";
import { compact } from "../base/format.js";
import { t } from "../base/words.js";

const SVG = "http://www.w3.org/2000/svg";
const [MINUTES, HEIGHT] = [60, 16];

/** @returns {{element: HTMLElement, update: (speeds: number[]) => void}} speeds: samples per second, one a minute, the newest last */
export function lastHour() {
  const element = document.createElement("dd");
  element.className = "hour";
  const none = document.createElement("span");
  setText(none, t("Nothing rendered"));
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", `0 0 ${MINUTES} ${HEIGHT}`);
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("role", "img");
  const bars = document.createElementNS(SVG, "path");
  svg.append(bars);
  element.append(none, svg);
  return {
    element,
    update(speeds) {
      const most = Math.max(0, ...speeds);
      none.hidden = most > 0;
      svg.style.display = most > 0 ? "" : "none";
      if (most === 0) return;
      const bar = (/** @type {number} */ speed, /** @type {number} */ i) => speed && `M${MINUTES - speeds.length + i} ${HEIGHT}h1v-${((HEIGHT * speed) / most).toFixed(2)}h-1Z`;
      bars.setAttribute("d", speeds.map(bar).filter(Boolean).join(""));
      svg.setAttribute("aria-label", t("{n} minutes: from {low} to {most} samples/s", { n: speeds.length, low: compact(Math.min(...speeds)), most: compact(most) }));
    },
  };
}
