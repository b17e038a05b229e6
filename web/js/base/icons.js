/** The page's icons: strokes on a 16-pixel grid in the text's colour, hidden from screen readers. */

const PATHS = {
  upload: "M8 11V2.5M4.5 6 8 2.5 11.5 6M2.5 10.5v2a1 1 0 0 0 1 1h9a1 1 0 0 0 1-1v-2",
  download: "M8 2.5V11M4.5 7.5 8 11l3.5-3.5M2.5 13.5h11",
  play: "M4.5 3v10l8-5z",
  pause: "M5 3v10M11 3v10",
  stop: "M4 4h8v8H4z",
  plus: "M8 3v10M3 8h10",
  close: "M4 4l8 8M12 4l-8 8",
  check: "M3 8.5 6.5 12 13 4.5",
  warning: "M8 2 14.5 13.5h-13zM8 6.5v3.2M8 11.6v.1",
  info: "M8 1.8a6.2 6.2 0 1 0 0 12.4A6.2 6.2 0 0 0 8 1.8M8 7.2v4M8 4.8v.1",
  trash: "M2.5 4h11M6 4V2.5h4V4M4 4l.6 9.5h6.8L12 4M6.7 6.5v4.5M9.3 6.5v4.5",
  camera: "M2 5h3l1.2-1.7h3.6L11 5h3v8H2zM8 6.6a2.2 2.2 0 1 0 0 4.4 2.2 2.2 0 0 0 0-4.4",
  sun: "M8 5.2a2.8 2.8 0 1 0 0 5.6 2.8 2.8 0 0 0 0-5.6M8 1v1.6M8 13.4V15M1 8h1.6M13.4 8H15M3 3l1.2 1.2M11.8 11.8 13 13M3 13l1.2-1.2M11.8 4.2 13 3",
  moon: "M13.2 9.6A5.7 5.7 0 0 1 6.4 2.8a5.7 5.7 0 1 0 6.8 6.8z",
  auto: "M8 2a6 6 0 1 0 0 12A6 6 0 0 0 8 2M8 2v12M10 3.2v9.6M12 4.6v6.8",
  back: "M9.5 3.5 5 8l4.5 4.5",
  down: "M3.5 6.5 8 11l4.5-4.5",
  next: "M6.5 3.5 11 8l-4.5 4.5",
  later: "M8 5.5a2.5 2.5 0 1 0 0 5A2.5 2.5 0 0 0 8 5.5",
  clock: "M8 1.8a6.2 6.2 0 1 0 0 12.4A6.2 6.2 0 0 0 8 1.8M8 4.5V8l2.4 1.6",
  person: "M8 2.2a2.9 2.9 0 1 0 0 5.8a2.9 2.9 0 0 0 0-5.8M2.6 14a5.4 5.4 0 0 1 10.8 0",
  worker: "M2.5 3h11v6.5h-11zM8 9.5V13M5 13h6M5 6.2h2.5",
  keep: "M4 2.5h8v11L8 10.5l-4 3z",
  exposure: "M2.5 2.5h11v11h-11zM3 13 13 3M4.3 6h3M5.8 4.5v3M9 10.6h3",
  fit: "M2.5 6V2.5H6M10 2.5h3.5V6M13.5 10v3.5H10M6 13.5H2.5V10",
  folder: "M1.8 12.8V3.5h4.4L7.8 5.3h6.4v7.5z",
  image: "M2 3h12v10H2zM2.2 11.2 6 7.5l3 3 2-1.8 2.8 2.6M10.6 5.8v.1",
  cube: "M8 1.8 13.5 5v6L8 14.2 2.5 11V5zM2.6 5 8 8.2 13.4 5M8 8.2v6",
  target: "M8 3.5a4.5 4.5 0 1 0 0 9 4.5 4.5 0 0 0 0-9M8 1v4M8 11v4M1 8h4M11 8h4",
  turn: "M13.5 8A5.5 2.2 0 1 1 8 5.8h3.5M9.5 3.5 11.8 5.8 9.5 8M8 1.5v1.5M8 13v1.5",
  wipe: "M6 5 3 8l3 3M10 5l3 3-3 3",
  compare: "M2 3h12v10H2zM8 1.5v13M2.3 11 5.5 7.8 7.5 10",
  swap: "M4.5 3 2 5.5 4.5 8M2.3 5.5H13M11.5 8 14 10.5 11.5 13M13.7 10.5H3",
  undo: "M5.5 2.5 2.5 5.5l3 3M2.8 5.5h6.7a4 4 0 0 1 0 8H6",
  refresh: "M13 8a5 5 0 1 1-1.6-3.7M13.2 2v2.8h-2.8",
  region: "M2.5 5V2.5H5M7 2.5h2M11 2.5h2.5V5M13.5 7v2M13.5 11v2.5H11M9 13.5H7M5 13.5H2.5V11M2.5 9V7M6 8h4M8 6v4",
  link: "M6.8 9.2a2.6 2.6 0 0 0 3.7 0l2.2-2.2a2.6 2.6 0 0 0-3.7-3.7l-.9.9M9.2 6.8a2.6 2.6 0 0 0-3.7 0L3.3 9a2.6 2.6 0 0 0 3.7 3.7l.9-.9",
  screen: "M1.8 3h12.4v8.2H1.8zM5.5 13.5h5",
  pencil: "M10.8 2.7 13.3 5.2 5.6 12.9 2.5 13.5 3.1 10.4zM9.3 4.2 11.8 6.7",
  probe: "M8.8 4.8l2.4 2.4M10 6l-5.6 5.6-2 .6.6-2L8.6 4.6M9.6 3.8l1.3-1.3a1.5 1.5 0 0 1 2.6 2.6l-1.3 1.3",
  pin: "M8 14.2C5 10.8 3.8 8.6 3.8 6.4a4.2 4.2 0 0 1 8.4 0c0 2.2-1.2 4.4-4.2 7.8M8 5v.1",
  more: "M3.5 8v.1M8 8v.1M12.5 8v.1",
  lines: "M3 4h10M3 8h10M3 12h6",
  path: "M2 12.5 6 5l4 5 4-7M2 12.5v.1M6 5v.1M10 10v.1",
  bell: "M4 11V7.2a4 4 0 0 1 8 0V11l1.3 1.5H2.7zM6.6 14.2h2.8",
  bellOff: "M4 11V7.2a4 4 0 0 1 .6-2.1M6.5 3.5A4 4 0 0 1 12 7.2V9M13.3 12.5H2.7L4 11M6.6 14.2h2.8M2.5 1.8l11 12",
  globe: "M8 1.8a6.2 6.2 0 1 0 0 12.4A6.2 6.2 0 0 0 8 1.8M1.9 8h12.2M8 1.8c-4 4-4 8.4 0 12.4M8 1.8c4 4 4 8.4 0 12.4",
  search: "M7 2.5a4.5 4.5 0 1 0 0 9 4.5 4.5 0 0 0 0-9M10.3 10.3l3.4 3.4",
  copy: "M5.5 5.5h8v8h-8zM3.5 10.5h-1v-8h8v1",
};

/** Icons drawn filled, since their outlines look like other symbols. */
const SOLID = new Set(["play", "stop"]);

/** @typedef {keyof typeof PATHS} IconName */

/**
 * @param {IconName} name
 * @returns {SVGSVGElement}
 */
export function icon(name) {
  const svg = document.createElementNS("http://www.w3.org/2000/svg", "svg");
  svg.setAttribute("viewBox", "0 0 16 16");
  svg.setAttribute("class", SOLID.has(name) ? "icon solid" : "icon");
  svg.setAttribute("aria-hidden", "true");
  const path = document.createElementNS("http://www.w3.org/2000/svg", "path");
  path.setAttribute("d", PATHS[name]);
  svg.append(path);
  return svg;
}
