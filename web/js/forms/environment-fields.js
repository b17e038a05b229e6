/** The environment light: the scene's own, a colour, a preset, a clear sky with its sun, or an uploaded image. */

import { hexOf, linearOf } from "../base/colour.js";
import { h, setText } from "../base/dom.js";
import { bytes } from "../base/format.js";
import { icon } from "../base/icons.js";
import { addEnvironment, dropEnvironment, environments, loadEnvironments } from "../news/environments.js";
import { known } from "../news/settings-table.js";
import { LIGHT_FILES, holdLight, registerLightReceiver } from "../shell/light-drop.js";
import { moreButton } from "../shell/more-button.js";
import { announce, showError } from "../shell/tray.js";
import { field, numberInput, numberOf, setShown } from "./fields.js";
import { lightChoices } from "./light-choices.js";
import { settingField } from "./setting-field.js";
import { sunDial } from "./sun-dial.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").EnvironmentRequest} EnvironmentRequest */
/** @typedef {import("../base/types.js").Environment} Environment */
/** @typedef {import("./light-choices.js").Light} Light */

/**
 * @typedef {object} LightHandle what a hand elsewhere than in these fields does with the light
 * @property {() => {rotation: number, strength: number, turns: boolean}} get turns: whether it has a direction
 * @property {(light: {rotation: number, strength: number}, isDone: boolean) => void} set
 * @property {() => {elevation: number, azimuth: number} | null} sun where it is seen, the light's rotation included; null: no clear sky
 * @property {(sun: {elevation: number, azimuth: number}, isDone: boolean) => void} stand puts it there, under a clear sky
 * @property {(id: string) => void} choose a light, as by its picture
 * @property {() => () => void} keep the light as it is now; gives what takes it back
 */

/** @type {Light[]} */
const ALWAYS = [
  { id: "own", label: t("From file"), help: t("The light in the file.") },
  { id: "color", label: t("One colour"), help: t("The same light from every direction.") },
];
/** In the place of the scene's own. @type {Light} */
const STAND_IN = { id: "own", face: "soft", label: t("Default"), help: t("The file has no light, so a soft studio light stands in.") };
/** @type {Light} */
const SKY = { id: "sky", label: t("Clear sky"), help: t("A clear day, with the sun where you put it.") };
/** The sun of a clear sky that is chosen without one, in degrees: high, since the light of a low one is yellow. */
export const DAY = { elevation: 50, azimuth: 120 };
const NOON = "noon";
/** The lights of the first row. */
const FIRST = ["own", "studio", "overcast", "sky"];
/** Presets of the first row until the service has listed its environments, so that the row does not change. @type {Environment[]} */
const EXPECTED = ["Studio", "Overcast"].map((name) => ({ id: name.toLowerCase(), name, help: "", kind: /** @type {const} */ ("preset"), environment: { preset: name.toLowerCase() }, thumbnail: "" }));
/** Event that asks the live view to place the sun by a click. */
export const PLACE_SUN = "place-sun";

/**
 * @param {Record<string, any>} first what the fields show first, where that is not each setting's default; `light`: a request's
 * @param {boolean} isLightless whether the scene has no light of its own, so that a studio light stands in
 * @param {string} [scene] its id
 * @returns {{element: HTMLElement, get: () => EnvironmentRequest, handle: LightHandle, dispose: () => void}} get: what differs from the scene's own
 */
export function environmentFields(first, isLightless, scene = "") {
  const { environment = null } = first;
  /** @type {EnvironmentRequest} */
  const before = first.light ?? {};
  const shown = environment ? hexOf(environment) : "#ffffff";
  const colour = h("input", { type: "color", value: shown });
  const sun = { elevation: before.sky?.elevation ?? DAY.elevation, azimuth: before.sky?.azimuth ?? DAY.azimuth };
  const elevation = numberInput({ value: sun.elevation, min: 0, max: 90, step: "any" });
  const azimuth = numberInput({ value: sun.azimuth, min: -360, max: 360, step: "any" });
  const numbers = known()
    .settings.filter(({ of, type }) => of === "environment" && type === "number")
    .map((setting) => settingField(setting, first[setting.name] ?? setting.default));
  const dial = sunDial((next, isDone) => {
    elevation.value = String(next.elevation);
    azimuth.value = String(next.azimuth);
    if (environmentOf(kind)?.sky) pick("sky"); // replaces the preset, whose sun is fixed
    tell(isDone);
  });
  dial.set(sun);
  for (const input of [elevation, azimuth])
    input.addEventListener("input", () => {
      dial.set({ elevation: numberOf(elevation, 0), azimuth: numberOf(azimuth, 0) });
      if (environmentOf(kind)?.sky) pick("sky");
    });

  let kind = kindOf(before, environment !== null);
  const hint = h("p", { class: "hint" });
  const note = h("p", { class: "quiet small stand-in" }, STAND_IN.help);
  const remove = h("button", { class: "text-button", type: "button", onclick: () => void forget() }, t("Remove this image"));
  const colourField = field(t("Colour"), colour);
  const sky = h(
    "div",
    { class: "sun-fields" },
    dial.element,
    h("div", { class: "stack" }, field(t("Sun's height, °"), elevation), field(t("Sun's direction, °"), azimuth)),
    h(
      "button",
      { class: "button small", type: "button", onclick: () => element.dispatchEvent(new CustomEvent(PLACE_SUN, { bubbles: true })) },
      icon("sun"),
      t("Place it in the view"),
    ),
  );
  const choices = lightChoices(
    (id) => {
      const preset = environmentOf(id)?.sky;
      if (preset) showSun({ elevation: preset.elevation, azimuth: preset.azimuth ?? 0 });
      pick(id);
      tell(true);
    },
    () => ask((file) => void add(file)),
  );
  const more = moreButton(environments);
  const opener = h("button", { class: "text-button light-more", type: "button", onclick: () => setOpen(opener, opener.getAttribute("aria-expanded") !== "true") });
  const element = h(
    "fieldset",
    { class: "light-panel" },
    h("legend", null, t("Light")),
    choices.element,
    note,
    colourField,
    sky,
    h(
      "div",
      { class: "light-rest" },
      more.element,
      h("div", { class: "row spread" }, hint, remove),
      h("div", { class: "light-sliders" }, numbers.map(({ element }) => element)),
    ),
    opener,
  );
  setOpen(opener, numbers.some(({ setting, get }) => get() !== setting.default));

  /** @param {{elevation: number, azimuth: number}} next as the sky has it */
  function showSun(next) {
    elevation.value = String(next.elevation);
    azimuth.value = String(next.azimuth);
    dial.set(next);
  }
  /** @param {string} id @returns {EnvironmentRequest | undefined} */
  function environmentOf(id) {
    return environments.value?.find((each) => each.id === id)?.environment;
  }
  const lights = () => {
    const known = environments.value ?? EXPECTED;
    /** @param {Environment} light @returns {Light} */
    const shownAs = ({ id, name, help, thumbnail }) => ({ id, label: name, help, picture: thumbnail.replace(/^\//, "") });
    const presets = known.filter((each) => each.kind === "preset").map((each) => ({ ...each, name: t(each.name), help: t(each.help) }));
    const noon = presets.find(({ id }) => id === NOON);
    const clear = { ...SKY, ...(noon && { picture: shownAs(noon).picture }) };
    const all = [...ALWAYS.map((light) => (light.id === "own" && isLightless ? STAND_IN : light)), ...presets.filter(({ environment }) => !environment.sky).map(shownAs), clear, ...presets.filter(({ environment }) => environment.sky).map(shownAs), ...known.filter((each) => each.kind === "image").map((each) => ({ ...shownAs(each), label: each.name.replace(/\.\w+$/, "") }))];
    const place = (/** @type {Light} */ { id }) => (FIRST.indexOf(id) + 1 || FIRST.length + 1);
    return all.sort((a, b) => place(a) - place(b));
  };
  /** @param {string} id */
  function pick(id) {
    kind = id;
    choices.select(id);
    const light = lights().find((each) => each.id === id);
    setText(hint, light?.help || light?.label || "");
    remove.hidden = environments.value?.find((each) => each.id === id)?.kind !== "image";
    setShown(colourField, id === "color");
    const isSky = id === "sky" || Boolean(environmentOf(id)?.sky);
    setShown(sky, isSky);
    note.hidden = !isLightless || isSky || id === "color";
    note.classList.toggle("unseen", id !== "own"); // it keeps its place, so that nothing below it moves
  }
  /** Dispatches events that update other parts of the form. @param {boolean} isDone */
  function tell(isDone) {
    element.dispatchEvent(new Event("input", { bubbles: true }));
    if (isDone) element.dispatchEvent(new Event("change", { bubbles: true }));
  }
  /** @param {File} file */
  async function add(file) {
    const added = await sent(file, choices);
    if (!added) return;
    pick(added.id);
    announce(t("Lit by {name}", { name: added.name }));
    tell(true);
  }
  async function forget() {
    const gone = kind;
    pick("own");
    tell(true);
    await dropEnvironment(gone).catch((error) => showError(t("The image was not removed"), error));
  }
  const listen = environments.subscribe(() => {
    choices.show(lights());
    pick(kind);
  });
  if (!environments.value) loadEnvironments().catch((error) => setText(hint, error.message));
  // The form that is shown before the view, in which nothing can be chosen, leaves the file to the next one.
  const drops = registerLightReceiver((file) => void (element.closest(".not-yet") ? holdLight(file, scene) : add(file)), scene);
  return {
    element,
    dispose: () => (listen(), drops(), more.dispose()),
    handle: lightHandle(),
    get: () => ({
      ...Object.fromEntries(
        numbers
          .map(({ setting, get }) => ({ setting, value: get() }))
          .filter(({ setting, value }) => value !== setting.default)
          .map(({ setting, value }) => [setting.name.replace("environment_", ""), value]),
      ),
      ...chosen(),
    }),
  };

  /** @returns {LightHandle} */
  function lightHandle() {
    /** @param {string} name */
    const inputOf = (name) =>
      /** @type {HTMLInputElement} */ (
        numbers.find(({ setting }) => setting.name === `environment_${name}`)?.element.querySelector("input[type=number]")
      );
    const [rotation, strength] = [inputOf("rotation"), inputOf("strength")];
    const show = () => {
      for (const input of [rotation, strength]) input.dispatchEvent(new Event("input")); // updates the slider and the reset mark
    };
    const isSky = () => kind === "sky" || Boolean(environmentOf(kind)?.sky);
    return {
      get: () => ({ rotation: numberOf(rotation, 0), strength: numberOf(strength, 1), turns: kind !== "color" }),
      set(light, isDone) {
        rotation.value = String(light.rotation);
        strength.value = String(light.strength);
        show();
        tell(isDone);
      },
      choose: (id) => (pick(id), tell(true)),
      sun: () => (isSky() ? { elevation: numberOf(elevation, 0), azimuth: numberOf(azimuth, 0) - numberOf(rotation, 0) } : null),
      stand(sun, isDone) {
        const tenths = (/** @type {number} */ value) => Math.round(value * 10) / 10;
        const inSky = (((sun.azimuth + numberOf(rotation, 0)) % 360) + 360) % 360;
        showSun({ elevation: tenths(sun.elevation), azimuth: tenths(inSky) % 360 });
        pick("sky");
        tell(isDone);
      },
      keep() {
        const [was, ...values] = [kind, elevation.value, azimuth.value, rotation.value, strength.value];
        return () => {
          [elevation, azimuth, rotation, strength].forEach((input, i) => (input.value = values[i] ?? ""));
          dial.set({ elevation: numberOf(elevation, 0), azimuth: numberOf(azimuth, 0) });
          show();
          pick(was);
          tell(true);
        };
      },
    };
  }

  /** @returns {EnvironmentRequest} */
  function chosen() {
    if (kind === "own") return {};
    if (kind === "color") return { color: environment && colour.value === shown ? environment : linearOf(colour.value) };
    const asked = environmentOf(kind);
    if (kind === "sky" || asked?.sky) return { sky: { elevation: elevation.valueAsNumber, azimuth: azimuth.valueAsNumber } };
    if (asked) return asked;
    return kind === before.image ? { image: kind } : { preset: kind }; // the list is not loaded yet
  }
}

/** Shows or hides the further lights and the light's settings. @param {HTMLElement} opener @param {boolean} isOpen */
function setOpen(opener, isOpen) {
  opener.parentElement?.classList.toggle("open", isOpen);
  opener.setAttribute("aria-expanded", String(isOpen));
  setText(opener, isOpen ? t("Less") : t("More"));
}

/** Shows the settings of the light that an element is among. @param {Element} element */
export function openMore(element) {
  const opener = element.closest(".light-panel")?.querySelector(".light-more");
  if (opener instanceof HTMLElement) setOpen(opener, true);
}

/** @param {EnvironmentRequest} light @param {boolean} hasColour */
function kindOf(light, hasColour) {
  if (hasColour) return "color";
  if (light.sky) return "sky";
  return light.preset ?? light.image ?? "own";
}

/** Opens the system's file dialog. @param {(file: File) => void} take */
function ask(take) {
  const input = h("input", { type: "file", accept: LIGHT_FILES, hidden: true });
  input.addEventListener("change", () => {
    if (input.files?.[0]) take(input.files[0]);
    input.remove();
  });
  input.addEventListener("cancel", () => input.remove());
  document.body.append(input);
  input.click();
}

/** Uploads an image, with its progress among the lights. @param {File} file @param {ReturnType<typeof lightChoices>} choices @returns {Promise<Environment | null>} */
async function sent(file, choices) {
  const abort = new AbortController();
  const place = choices.await(file, () => abort.abort());
  place.update(0, t("Uploading {size}", { size: bytes(file.size) }));
  try {
    return await addEnvironment(file, {
      signal: abort.signal,
      progress: (done, all) => (done < all ? place.update(done / all, t("{done} of {all}", { done: bytes(done), all: bytes(all) })) : place.update(null, t("A worker is checking it …"))),
    });
  } catch (error) {
    if (!abort.signal.aborted) showError(t("{name} was not accepted", { name: file.name }), error);
    return null;
  } finally {
    place.remove();
  }
}
