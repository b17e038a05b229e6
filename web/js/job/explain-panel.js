/** Explanation of a pixel: the paths of some samples, drawn over the picture, with a table of their vertices and light. */

import { explainPixel } from "../news/api.js";
import { fill, h, setText } from "../base/dom.js";
import { luminanceOf } from "../base/colour.js";
import { count, radiance } from "../base/format.js";
import { drawPath } from "../film/path-lines.js";
import { icon } from "../base/icons.js";
import { announce } from "../shell/tray.js";
import { toolWord } from "./picture-tools.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Explained} Explained */
/** @typedef {import("../base/types.js").PixelPath} PixelPath */
/** @typedef {import("../base/types.js").PathVertex} PathVertex */
/** @typedef {{x: number, y: number}} Pixel */

/** @type {Record<string, string>} */
const ENDS = {
  missed: t("It left the scene."),
  absorbed: t("All its light was absorbed."),
  roulette: t("Russian roulette ended it."),
  depth: t("It reached the maximum depth."),
  diffuse: t("It reached the maximum diffuse depth."),
  glossy: t("It reached the maximum glossy depth."),
  transmission: t("It reached the maximum transmission depth."),
  caught: t("It hit too many surfaces at one place."),
  unlit: t("The material scatters no light."),
  passed: t("It reached the maximum transparency depth."),
};
/** @type {Record<string, string>} */
const CHOSEN = { asked: t("Requested"), first: t("First"), median: t("Median"), brightest: t("Brightest") };
/** @type {Record<string, string>} */
const BOUNCES = { reflected: t("reflected"), transmitted: t("let through") };
const LAST_SAMPLE = 1048575;

/** @param {number[]} rgb */
/** @param {(number | null)[] | null} values */
const listed = (values) => (values ? values.map((value) => (value == null ? "–" : radiance(value))).join("  ") : "–");
/** @param {number[]} a @param {number[]} b */
const sum = (a, b) => a.map((value, i) => value + (b[i] ?? 0));
/** Returns a number of samples per pixel in words. @param {number} n */
const samplesText = (n) => tn(n, "{n} sample", "{n} samples", { n: count(n) });
/** @param {number} share */
const percent = (share) => `${Number((share * 100).toPrecision(3))} %`;

/** Part of a pixel's light from which a single sample is a firefly, and shown first. */
const FIREFLY = 0.25;
/** Number of samples from which one that brings so much is conspicuous. */
const FEW = 16;

/**
 * @param {import("../film/live-picture.js").LivePicture} picture
 * @param {import("../base/store.js").Disposer} life
 * @param {{around: (sample: number) => {without: number | null, with: number | null}, goTo: (spp: number | null) => void} | null} moments
 *   the picture's sample history, if it has one
 * @param {(isShown: boolean) => void} opened called when it is shown, also for another pixel, and when it is closed
 */
export function explainPanel(picture, life, moments, opened) {
  const { view, live } = picture;
  const title = h("h2", null, t("Paths of a pixel"));
  const shut = h("button", { class: "icon-button", type: "button", "aria-label": t("Close the paths"), title: t("Close (Escape)"), onclick: () => close() }, icon("close"));
  const body = h("div", { class: "stack tight" });
  const element = h("section", { class: "side-section stack tight explained", "aria-label": t("Paths of a pixel"), hidden: true }, h("div", { class: "row spread" }, title, shut), body);
  let asking = new AbortController();
  /** @type {Pixel | null} */
  let pixel = null;
  /** @type {{path: PixelPath, chosen: number | null} | null} */
  let shown = null;
  life.add(() => asking.abort());

  const draw = () => {
    const { path, chosen } = shown ?? {};
    view?.over.setMark("path", pixel && path ? (over, ratio) => pixel && drawPath(over, ratio, pixel, path.vertices, chosen ?? null) : null);
  };
  const close = () => {
    asking.abort();
    turn(false);
    const hadFocus = element.contains(document.activeElement);
    pixel = shown = null;
    element.hidden = true;
    opened(false);
    draw();
    if (hadFocus) button.focus();
  };
  /** @param {Pixel} at @param {number | null} [sample] */
  const explain = async (at, sample = null) => {
    asking.abort();
    const { signal } = (asking = new AbortController());
    pixel = at;
    element.hidden = false;
    opened(true);
    setText(title, t("Paths of pixel {x}, {y}", { x: at.x, y: at.y }));
    if (sample === null) {
      shown = null;
      draw();
      fill(body, h("p", { class: "quiet", role: "status" }, t("A worker is tracing its paths again …")));
    }
    element.scrollIntoView({ block: "nearest" });
    try {
      const found = await explainPixel({ job: live.job, frame: live.frame }, at.x, at.y, sample, signal);
      show(found, sample);
    } catch (error) {
      if (signal.aborted) return;
      const again = h("button", { class: "button", type: "button", onclick: () => void explain(at, sample) }, icon("refresh"), t("Try again"));
      fill(body, h("div", { class: "notice error", role: "alert" }, icon("warning"), h("div", { class: "grow stack tight" }, /** @type {Error} */ (error).message, again)));
    }
  };

  /** @param {Explained} found @param {number | null} sample */
  const show = (found, sample) => {
    const detail = h("div", { class: "stack tight" });
    const brightest = found.paths.find((path) => path.chosen.includes("brightest"));
    const share = shareOf(found, brightest);
    const isFirefly = found.samples >= FEW && share > FIREFLY;
    const first = (sample === null ? isFirefly && brightest : found.paths.find((path) => path.sample === sample)) || found.paths[0];
    const name = `path-${found.x}-${found.y}`;
    const choices = found.paths.map((path) => {
      const words = path.chosen.map((choice) => CHOSEN[choice] ?? choice).join(", ");
      const radio = h("input", { type: "radio", name, onchange: () => pick(path) });
      radio.checked = path === first;
      return h("label", null, radio, h("span", { class: "grow" }, words), h("span", { class: "quiet number" }, `#${path.sample}`), h("span", { class: "mono" }, path.value ? radiance(luminanceOf(path.value)) : t("not a number")));
    });
    const pick = (/** @type {PixelPath} */ path) => {
      shown = { path, chosen: null };
      fill(detail, inHistory(path.sample), ...pathDetail(path, (chosen) => ((shown = { path, chosen }), draw())));
      draw();
    };
    const inHistory = (/** @type {number} */ sample) => {
      const { without = null, with: having = null } = moments?.around(sample) ?? {};
      const link = (/** @type {number | null} */ spp, /** @type {string} */ text) => spp !== null && h("button", { class: "text-button small", type: "button", onclick: () => moments?.goTo(spp) }, text);
      if (without === null && having === null) return null;
      return h("p", { class: "row small" }, h("span", { class: "quiet" }, t("Sample history")), link(without, t("Without it: {picture}", { picture: samplesText(without ?? 0) })), link(having, t("With it: {picture}", { picture: samplesText(having ?? 0) })));
    };
    const number = h("input", { type: "number", min: 0, max: LAST_SAMPLE, step: 1, "aria-label": t("Number of a sample"), value: sample === null ? "" : String(sample) });
    const other = h("form", { class: "row other-sample", onsubmit: (/** @type {Event} */ event) => (event.preventDefault(), number.value && void explain({ x: found.x, y: found.y }, number.valueAsNumber)) }, h("span", { class: "quiet" }, t("Another sample")), number, h("button", { class: "button", type: "submit" }, t("Follow")));
    fill(
      body,
      isFirefly && h("p", { class: "small" }, t("A firefly: sample {n} alone brings {share} of this pixel's light.", { n: brightest?.sample ?? 0, share: percent(share) })),
      h("p", { class: "quiet small", role: "status" }, verdict(found)),
      h("div", { class: "paths", role: "radiogroup", "aria-label": t("Samples of this pixel, with their luminance") }, choices),
      other,
      detail,
    );
    if (first) pick(first);
    announce(t("The pixel's paths are shown"));
  };

  let isOn = false;
  const turn = (/** @type {boolean} */ on) => {
    isOn = on;
    button.setAttribute("aria-pressed", String(on));
  };
  const button = h("button", { class: "icon-button", type: "button", "aria-pressed": "false", "aria-label": t("Show a pixel's paths"), onclick: () => turn(!isOn) }, icon("path"), toolWord(t("Show paths")));
  button.title = t("Show paths: click on a pixel to see how its light was found (Q: at the cursor)");
  if (view) {
    /** @type {Pixel | null} */
    let from = null;
    life.listen(view.element, "pointerdown", (/** @type {PointerEvent} */ event) => {
      from = isOn && event.button === 0 && !event.shiftKey ? { x: event.clientX, y: event.clientY } : null;
    });
    life.listen(view.element, "pointerup", (/** @type {PointerEvent} */ event) => {
      const isStill = from && Math.hypot(event.clientX - from.x, event.clientY - from.y) < 4;
      from = null;
      if (isStill && view.over.cursor) void explain({ ...view.over.cursor });
    });
    life.add(live.onTurn(() => pixel && close())); // another frame's
  }
  return {
    element,
    button,
    explain,
    close: () => void ((pixel || isOn) && close()),
    /** @type {import("../shell/shortcuts.js").Shortcut[]} */
    keys: [
      { keys: "Q", does: t("Show the paths of the pixel under the cursor"), run: () => view?.over.cursor && void explain({ ...view.over.cursor }) },
    ],
  };
}

/**
 * The part of a pixel's light that one of its samples brings; 1 if the sample is not finite.
 *
 * @param {Explained} found
 * @param {PixelPath | undefined} path
 */
function shareOf({ samples, mean }, path) {
  if (!path || !mean) return 0;
  return path.value ? luminanceOf(path.value) / (luminanceOf(mean) * samples || 1) : 1;
}

/** @param {Explained} found @returns {string} */
function verdict({ samples, mean, equals_film: equals, worker }) {
  if (!samples) return t("The pixel has no samples yet; its first one is shown.");
  const said = t("{n} samples followed again by {worker}; their mean, not denoised, is {mean}.", { n: count(samples), worker: worker ?? "?", mean: listed(mean) });
  return `${said} ${equals === true ? t("Their sum equals the picture exactly.") : equals === false ? t("Their sum differs from the picture: the picture or the scene has changed.") : ""}`;
}

/** @param {PixelPath} path @param {(chosen: number | null) => void} look */
function pathDetail(path, look) {
  const about = h("dl", { class: "facts number", hidden: true, "aria-live": "polite" });
  const buttons = path.vertices.map((_, i) => {
    const place = h("button", { class: "vertex", type: "button", "aria-pressed": "false", "aria-label": t("Vertex {n}", { n: i + 1 }), onclick: () => choose(place.getAttribute("aria-pressed") === "true" ? null : i) }, String(i + 1));
    return place;
  });
  const choose = (/** @type {number | null} */ chosen) => {
    buttons.forEach((button, i) => button.setAttribute("aria-pressed", String(i === chosen)));
    const vertex = chosen === null ? undefined : path.vertices[chosen];
    about.hidden = !vertex;
    fill(about, ...(vertex ? facts(vertex) : []).map(([name, value]) => h("div", null, h("dt", null, name), h("dd", null, value))));
    look(chosen);
  };
  const heads = [["#", t("Number")], [t("Hit"), ""], [t("Weight"), t("Throughput: factor for radiance from here")], [t("Light"), t("Light added to the sample")]];
  return [
    h(
      "table",
      { class: "path-table" },
      h("caption", { class: "visually-hidden" }, t("Vertices of the path, from the camera on")),
      h("thead", null, h("tr", null, heads.map(([text, title]) => h("th", { scope: "col", title: title || null }, text)))),
      h("tbody", null, path.vertices.map((vertex, i) => row(vertex, buttons[i]))),
    ),
    about,
    h("p", { class: "small" }, path.end ? (ENDS[path.end] ?? path.end) : ""),
    legend(),
  ];
}

/** @param {PathVertex} vertex @param {HTMLElement | undefined} button */
function row(vertex, button) {
  const { kind, throughput, emitted, direct, beside, light } = vertex;
  const brought = luminanceOf(sum(sum(emitted, direct), beside));
  const lit = isBlocked(light, direct) ? t("blocked") : "";
  return h(
    "tr",
    null,
    h("th", { scope: "row" }, button),
    h("td", null, h("span", { class: "met" }, nameOf(vertex)), h("span", { class: "quiet small" }, kind === "surface" ? lobe(vertex) : kind === "passed" ? (emitted.some(Boolean) ? t("a lamp, which stops nothing") : t("passed by its alpha")) : "")),
    h("td", { class: "mono", title: listed(throughput) }, radiance(luminanceOf(throughput))),
    h("td", { class: "mono", title: listed(sum(sum(emitted, direct), beside)) }, brought ? `+${radiance(brought)}` : "–", h("span", { class: "quiet small" }, lit)),
  );
}

/** @param {PathVertex["light"]} light @param {number[]} direct */
const isBlocked = (light, direct) => !!light?.brought.some(Boolean) && !direct.some(Boolean);

/** @param {PathVertex} vertex */
const nameOf = ({ kind, object_name: object, material_name: material, object: number }) =>
  kind === "missed" ? t("Environment") : kind === "medium" ? t("A medium") : [object || (number == null ? "" : t("Object {n}", { n: number })), material !== object && material].filter(Boolean).join(", ");

/** @param {PathVertex} vertex */
const lobe = ({ model, bounce }) => [model, bounce ? BOUNCES[bounce] : ""].filter(Boolean).join(", ");

/** @param {PathVertex} vertex @returns {[string, string][]} */
function facts(vertex) {
  const { light, point, distance, throughput, emitted, emitted_weight: weight, direct, beside, pdf, survival } = vertex;
  /** @type {[string, string | null | false][]} */
  const all = [
    [t("Position"), point && listed(point)],
    [t("Distance"), distance != null && radiance(distance)],
    [t("Throughput"), listed(throughput)],
    [t("Emitted light"), emitted.some(Boolean) && listed(emitted)],
    [t("MIS weight"), weight != null && percent(weight)],
    [t("Contribution of the second branch"), beside.some(Boolean) && listed(beside)],
    [t("Point on the light"), light && (light.point ? listed(light.point) : t("at infinity"))],
    [t("Unblocked contribution"), light && listed(light.brought)],
    [t("Contribution"), light && (isBlocked(light, direct) ? t("none, it is blocked") : listed(direct))],
    [t("MIS weight"), light && percent(light.weight)],
    [t("Probability of the light"), light?.pdf != null && t("{pdf} per steradian", { pdf: radiance(light.pdf) })],
    [t("Continues"), lobe(vertex)],
    [t("Pdf of the direction"), pdf != null && t("{pdf} per steradian", { pdf: radiance(pdf) })],
    [t("Roulette survival"), survival != null && percent(survival)],
  ];
  return all.flatMap(([name, value]) => (value ? [/** @type {[string, string]} */ ([name, value])] : []));
}

function legend() {
  const line = (/** @type {string} */ kind, /** @type {string} */ text) => h("li", null, h("span", { class: `sample-line ${kind}`, "aria-hidden": "true" }), text);
  return h("ul", { class: "path-legend small quiet" }, line("way", t("path")), line("lit", t("light that arrives: dashes, diamond")), line("blocked", t("light that is blocked: dots, cross")));
}
