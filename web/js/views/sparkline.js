/** A small line chart of a value over time. */

import { t } from "../base/words.js";

const SVG = "http://www.w3.org/2000/svg";
const MINUTES = 60;

/** @returns {{element: HTMLElement, update: (values: number[]) => void}} values: one a minute, the newest last */
export function sparkline() {
  const element = document.createElement("dd");
  element.className = "spark";
  const svg = document.createElementNS(SVG, "svg");
  svg.setAttribute("viewBox", "0 0 60 16");
  svg.setAttribute("preserveAspectRatio", "none");
  svg.setAttribute("role", "img");
  const area = document.createElementNS(SVG, "path");
  area.setAttribute("class", "area");
  const line = document.createElementNS(SVG, "path");
  line.setAttribute("class", "line");
  svg.append(area, line);
  element.append(svg);
  return {
    element,
    update(values) {
      const most = Math.max(...values, 1);
      const points = values.map((value, i) => `${MINUTES - values.length + i + 0.5} ${(15 - (14 * value) / most).toFixed(2)}`);
      const first = points[0];
      // A single value is drawn as a short line.
      line.setAttribute("d", first ? `M${points.join("L")}h0.5` : "");
      area.setAttribute("d", first ? `M${points.join("L")}h0.5V16H${first.split(" ")[0]}Z` : "");
      const low = Math.min(...values);
      svg.setAttribute("aria-label", values.length ? t("{n} minutes: from {low} to {most} samples/s", { n: values.length, low: compactly(low), most: compactly(most) }) : t("no figures yet"));
    },
  };
}

/** @param {number} value */
const compactly = (value) => Intl.NumberFormat("en", { notation: "compact" }).format(value);
