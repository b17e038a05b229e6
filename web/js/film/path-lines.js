/**
 * A light path over the picture: numbered vertices with lines between them, and dashed lines to sampled lights. Lines end at the
 * canvas' edge with an arrow where they leave it. An unoccluded light is marked with a diamond, an occluder with a cross.
 */

import { SANS } from "./pixel-overlay.js";

/** @typedef {import("../base/types.js").Spot} Spot */
/** @typedef {import("../base/types.js").PathVertex} PathVertex */
/** @typedef {{x: number, y: number}} Point */
/** @typedef {{from: Point, to: Point, isCut: boolean}} Line isCut: the line continues beyond `to` */

/** Near clipping distance in scene units, for lines that pass behind the eye. */
const NEAREST = 1e-4;
const PATH = "#fff";
const LIT = "#ffe06b";
const BLOCKED = "#ff9a8f";
const CHOSEN = "#5cc8ff";

/**
 * The visible part of the line between two spots, clipped to the canvas; null if there is none.
 *
 * @param {Spot} a
 * @param {Spot} b
 * @param {{x: number, y: number, scale: number}} place of the picture on the canvas
 * @param {{left: number, top: number, right: number, bottom: number}} room
 * @returns {Line | null}
 */
export function lineBetween(a, b, place, room) {
  const least = NEAREST * Math.max(Math.abs(a[2]), Math.abs(b[2]), 1e-12);
  if (a[2] < least && b[2] < least) return null;
  const start = a[2] < least ? mixed(a, b, least) : a;
  const end = b[2] < least ? mixed(b, a, least) : b;
  const from = onCanvas(start, place);
  const to = onCanvas(end, place);
  const cut = clipped(from, to, room);
  return cut && { from: cut[0], to: cut[1], isCut: end !== b || Math.hypot(cut[1].x - to.x, cut[1].y - to.y) > 0.5 };
}

/** @param {Spot} behind @param {Spot} before @param {number} w @returns {Spot} the place between at which it is so far ahead */
function mixed(behind, before, w) {
  const share = (w - behind[2]) / (before[2] - behind[2]);
  return [behind[0] + share * (before[0] - behind[0]), behind[1] + share * (before[1] - behind[1]), w];
}

/** @param {Spot} spot @param {{x: number, y: number, scale: number}} place @returns {Point} */
const onCanvas = ([x, y, w], { x: left, y: top, scale }) => ({ x: left + (x / w) * scale, y: top + (y / w) * scale });

/**
 * Liang-Barsky clipping of a line by a rectangle.
 *
 * @param {Point} a
 * @param {Point} b
 * @param {{left: number, top: number, right: number, bottom: number}} room
 * @returns {[Point, Point] | null}
 */
function clipped(a, b, { left, top, right, bottom }) {
  const dx = b.x - a.x;
  const dy = b.y - a.y;
  let first = 0;
  let last = 1;
  for (const [step, away] of /** @type {const} */ ([
    [-dx, a.x - left],
    [dx, right - a.x],
    [-dy, a.y - top],
    [dy, bottom - a.y],
  ])) {
    if (step === 0 && away < 0) return null;
    if (step < 0) first = Math.max(first, away / step);
    if (step > 0) last = Math.min(last, away / step);
  }
  if (first > last) return null;
  const at = (/** @type {number} */ share) => ({ x: a.x + share * dx, y: a.y + share * dy });
  return [at(first), at(last)];
}

/**
 * @param {import("./pixel-overlay.js").PixelOverlay} over
 * @param {number} ratio
 * @param {{x: number, y: number}} pixel
 * @param {PathVertex[]} vertices
 * @param {number | null} chosen the vertex that is looked at
 */
export function drawPath(over, ratio, pixel, vertices, chosen) {
  const { viewport } = over;
  const inset = 10 * ratio;
  const { width, height } = viewport.canvas;
  const room = { left: inset, top: inset, right: width - inset, bottom: height - inset };
  const line = (/** @type {Spot} */ a, /** @type {Spot} */ b) => lineBetween(a, b, viewport, room);
  /** @type {Spot} */
  const start = [pixel.x + 0.5, pixel.y + 0.5, 1];
  for (const [i, { light, direct, spot }] of vertices.entries()) {
    const towards = light?.brought.some(Boolean) && line(spot, light.spot);
    if (!towards) continue;
    const isSeen = direct.some((value) => value !== 0);
    stroke(over, ratio, towards, isSeen ? LIT : BLOCKED, isSeen ? [7, 5] : [2, 5], chosen === i);
    if (towards.isCut) arrow(over, ratio, towards, isSeen ? LIT : BLOCKED);
    else if (isSeen) diamond(over, ratio, towards.to);
    else cross(over, ratio, towards.to);
  }
  /** @type {Spot} */
  let before = start;
  for (const [i, vertex] of vertices.entries()) {
    const found = line(before, vertex.spot);
    before = vertex.spot;
    if (!found) continue;
    stroke(over, ratio, found, PATH, [], chosen === i);
    if (found.isCut || vertex.kind === "missed") arrow(over, ratio, found, PATH);
  }
  mark(over, ratio, onCanvas(start, viewport));
  for (const [i, { spot, kind }] of vertices.entries()) {
    if (kind === "missed" || spot[2] <= 0) continue;
    const at = onCanvas(spot, viewport);
    if (at.x < 0 || at.y < 0 || at.x > width || at.y > height) continue;
    disc(over, ratio, at, String(i + 1), chosen === i);
  }
}

/**
 * @param {import("./pixel-overlay.js").PixelOverlay} over
 * @param {number} ratio
 * @param {Line} line
 * @param {string} colour
 * @param {number[]} dashes
 * @param {boolean} isChosen
 */
function stroke({ context }, ratio, { from, to }, colour, dashes, isChosen) {
  const wide = isChosen ? 3 : 1.75;
  for (const [style, width] of /** @type {const} */ ([
    ["rgb(0 0 0 / 0.7)", wide + 2],
    [colour, wide],
  ])) {
    context.strokeStyle = style;
    context.lineWidth = width * ratio;
    context.lineCap = "round";
    context.setLineDash(dashes.map((dash) => dash * ratio));
    context.beginPath();
    context.moveTo(from.x, from.y);
    context.lineTo(to.x, to.y);
    context.stroke();
  }
  context.setLineDash([]);
  context.lineCap = "butt";
}

/** @param {import("./pixel-overlay.js").PixelOverlay} over @param {number} ratio @param {Line} line @param {string} colour */
function arrow({ context }, ratio, { from, to }, colour) {
  const angle = Math.atan2(to.y - from.y, to.x - from.x);
  const back = (/** @type {number} */ turn) => ({ x: to.x - 10 * ratio * Math.cos(angle + turn), y: to.y - 10 * ratio * Math.sin(angle + turn) });
  shape(context, ratio, [to, back(0.45), back(-0.45)], colour);
}

/** @param {import("./pixel-overlay.js").PixelOverlay} over @param {number} ratio @param {Point} at */
function diamond({ context }, ratio, { x, y }) {
  const r = 6 * ratio;
  const corners = [{ x, y: y - r }, { x: x + r, y }, { x, y: y + r }, { x: x - r, y }];
  shape(context, ratio, corners, LIT);
}

/** @param {import("./pixel-overlay.js").PixelOverlay} over @param {number} ratio @param {Point} at */
function cross(over, ratio, { x, y }) {
  const r = 4.5 * ratio;
  for (const side of [-1, 1]) {
    stroke(over, ratio, { from: { x: x - r, y: y - side * r }, to: { x: x + r, y: y + side * r }, isCut: false }, BLOCKED, [], false);
  }
}

/** @param {import("./pixel-overlay.js").PixelOverlay} over @param {number} ratio @param {Point} at the pixel that is explained */
function mark(over, ratio, { x, y }) {
  const { context } = over;
  const r = Math.max(5 * ratio, over.viewport.scale / 2);
  for (const [style, width] of /** @type {const} */ ([
    ["rgb(0 0 0 / 0.75)", 3.5],
    [CHOSEN, 1.75],
  ])) {
    context.strokeStyle = style;
    context.lineWidth = width * ratio;
    context.strokeRect(x - r, y - r, 2 * r, 2 * r);
  }
}

/**
 * @param {import("./pixel-overlay.js").PixelOverlay} over
 * @param {number} ratio
 * @param {Point} at
 * @param {string} text
 * @param {boolean} isChosen
 */
function disc(over, ratio, { x, y }, text, isChosen) {
  const { context } = over;
  context.beginPath();
  context.arc(x, y, 9 * ratio, 0, 2 * Math.PI);
  context.fillStyle = isChosen ? CHOSEN : "#fff";
  context.fill();
  context.lineWidth = (isChosen ? 3 : 1.5) * ratio;
  context.strokeStyle = "rgb(0 0 0 / 0.8)";
  context.stroke();
  context.font = `600 ${12 * ratio}px ${SANS}`;
  context.textAlign = "center";
  over.text(text, x, y + 4 * ratio, "#111", 0);
  context.textAlign = "start";
}

/** @param {CanvasRenderingContext2D} context @param {number} ratio @param {Point[]} corners @param {string} colour */
function shape(context, ratio, corners, colour) {
  context.beginPath();
  corners.forEach(({ x, y }, i) => (i ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.closePath();
  context.lineWidth = 2 * ratio;
  context.strokeStyle = "rgb(0 0 0 / 0.75)";
  context.stroke();
  context.fillStyle = colour;
  context.fill();
}
