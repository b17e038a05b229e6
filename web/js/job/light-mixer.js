/** The light mixer: gain, tint, mute and solo of each light group of a picture. The film stays as rendered. */

import { lightGroups, lightName } from "../film/channels.js";
import { MOST_STOPS, clampStops, isPlain, plainStrip } from "../film/light-mix.js";
import { h, setText } from "../base/dom.js";
import { MOST_GROUPS } from "../forms/setting-field.js";
import { icon } from "../base/icons.js";
import { roughly, stops } from "../base/format.js";
import { scenes } from "../news/farm.js";
import { isRead, settingOf } from "../news/settings-table.js";
import { linkTo } from "../shell/router.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/store.js").Store<import("./display-panel.js").Display>} DisplayStore */
/** @typedef {import("../film/light-mix.js").Strip} Strip */

/** Returns whether a job's picture has lights to mix, or would have them if it were rendered again, which is known once the scenes are listed. @param {import("../base/types.js").Job} job */
export function canMixLights(job) {
  const scene = scenes.value?.find(({ id }) => id === job.scene);
  return lightGroups(job.settings).length > 0 || (scene?.light_groups ?? []).length > 0;
}

/**
 * @param {DisplayStore} display
 * @param {() => import("../base/types.js").Job} job the latest state
 * @param {import("../base/store.js").Disposer} life
 * @param {(groups: string[]) => Promise<void>} renderWith renders the picture again with these light groups
 * @returns {HTMLElement}
 */
export function lightMixer(display, job, life, renderWith) {
  const groups = lightGroups(job().settings);
  if (!groups.length) return withoutGroups(job, life, renderWith);
  /** Changes a strip, and shows the colour where another channel was shown. @param {string} name @param {Partial<Strip>} changes */
  const change = (name, changes) =>
    display.update((d) => ({ ...d, channel: "", mix: d.mix.map((strip) => (strip.name === name ? { ...strip, ...changes } : strip)) }));
  const strips = groups.map((name) => stripOf(name, (changes) => change(name, changes)));
  const reset = h(
    "button",
    { class: "text-button small", type: "button", onclick: () => display.update((d) => ({ ...d, mix: groups.map(plainStrip) })) },
    t("Reset"),
  );
  life.add(
    display.subscribe(({ mix }) => {
      const hasSolo = mix.some(({ solo }) => solo);
      mix.forEach((strip, i) => strips[i]?.update(strip, hasSolo));
      reset.style.visibility = mix.every(isPlain) ? "hidden" : "";
    }),
  );
  return h(
    "section",
    { class: "side-section stack light-mixer", "aria-label": t("Lights") },
    h("div", { class: "row spread" }, h("h2", null, t("Lights")), reset),
    strips.map(({ element }) => element),
    h("p", { class: "quiet small" }, t("The link of this page and saved pictures have the mix.")),
  );
}

/**
 * @param {string} name of the group
 * @param {(changes: Partial<Strip>) => void} change
 */
function stripOf(name, change) {
  const label = lightName(name);
  const tint = h("input", {
    type: "color",
    "aria-label": t("Tint of {group}", { group: label }),
    title: t("Tint"),
    oninput: () => change({ tint: tint.value }),
  });
  const value = h("output", { class: "mono small" });
  const mute = toggle(t("Mute"), "M", label, () => change({ muted: mute.getAttribute("aria-pressed") !== "true" }));
  const solo = toggle(t("Solo"), "S", label, () => change({ solo: solo.getAttribute("aria-pressed") !== "true" }));
  const slider = h("input", {
    type: "range",
    class: "centred",
    "aria-label": t("Gain of {group}", { group: label }),
    ...{ min: -MOST_STOPS, max: MOST_STOPS, step: 0.1 },
    oninput: () => change({ stops: clampStops(slider.valueAsNumber) }),
    ondblclick: () => change({ stops: 0 }),
    onkeydown: (/** @type {KeyboardEvent} */ event) => {
      const { key, ctrlKey, metaKey, altKey } = event;
      if (ctrlKey || metaKey || altKey) return;
      const button = key === "m" ? mute : key === "s" ? solo : null;
      if (!button && key !== "0") return;
      event.preventDefault();
      event.stopPropagation(); // the page's keys have other meanings
      if (button) button.click();
      else change({ stops: 0 });
    },
  });
  const element = h(
    "div",
    { class: "mix-strip", role: "group", "aria-label": label },
    h("div", { class: "row" }, tint, h("span", { class: "name" }, label), h("span", { class: "grow" }), value, mute, solo),
    slider,
  );
  /** @param {Strip} strip @param {boolean} hasSolo whether some group is solo */
  const update = (strip, hasSolo) => {
    slider.valueAsNumber = strip.stops;
    slider.setAttribute("aria-valuetext", t("{n} stops", { n: stops(strip.stops) }));
    setText(value, `${stops(strip.stops)} EV`);
    if (tint.value !== strip.tint) tint.value = strip.tint;
    mute.setAttribute("aria-pressed", String(strip.muted));
    solo.setAttribute("aria-pressed", String(strip.solo));
    element.classList.toggle("off", hasSolo ? !strip.solo : strip.muted);
  };
  return { element, update };
}

/** @param {string} does @param {string} letter its key on the slider @param {string} group @param {() => void} run */
const toggle = (does, letter, group, run) =>
  h(
    "button",
    { class: "mix-toggle", type: "button", "aria-pressed": "false", "aria-label": `${does}: ${group}`, title: `${does} (${letter})`, onclick: run },
    does,
  );

/**
 * How to get light groups, with a button that renders the picture again with them.
 *
 * @param {() => import("../base/types.js").Job} latest
 * @param {import("../base/store.js").Disposer} life
 * @param {(groups: string[]) => Promise<void>} renderWith
 */
function withoutGroups(latest, life, renderWith) {
  const job = latest();
  const told = h("p", { class: "quiet small" });
  const again = h("a", { class: "button", href: `${linkTo("scenes", job.scene)}?like=${job.id}` }, icon("refresh"), t("Render with other settings"));
  const start = async () => {
    render.disabled = true;
    await renderWith(groups);
    render.disabled = false;
  };
  const render = h("button", { class: "button primary for-submit", type: "button", onclick: () => void start() }, icon("refresh"), t("Render again to mix"));
  const price = h("p", { class: "quiet small" });
  const tellPrice = () => {
    const { state, elapsed_s: seconds, taken } = latest();
    const compiles = t("The first picture with separate lights takes about half a minute longer.");
    setText(price, state === "finished" && !taken && seconds >= 1 ? `${t("Takes {time}, as this picture did.", { time: roughly(seconds) })} ${compiles}` : compiles);
  };
  life.every(1000, tellPrice);
  tellPrice();
  /** @type {string[]} */
  let groups = [];
  life.add(
    scenes.subscribe((all) => {
      const scene = all?.find(({ id }) => id === job.scene);
      groups = (scene?.light_groups ?? []).slice(0, MOST_GROUPS);
      const canSplit = isRead(settingOf("settings", "light_groups"), job.settings?.["integrator"] ?? "path");
      price.hidden = render.hidden = !canSplit;
      again.hidden = canSplit;
      setText(
        told,
        canSplit
          ? t("Rendered again, this picture gets a slider for each light: {groups}.", { groups: groups.join(", ") })
          : t("Lights can be mixed in pictures of path tracing and of direct light only."),
      );
    }),
  );
  return h("section", { class: "side-section stack", "aria-label": t("Lights") }, h("h2", null, t("Lights")), told, render, price, again);
}
