/** The fields of all the renderer's settings: light, basic and advanced. */

import { h } from "../base/dom.js";
import { environmentFields } from "./environment-fields.js";
import { setShown } from "./fields.js";
import { backgroundField, groupsField, settingField } from "./setting-field.js";
import { isRead, known, settingOf } from "../news/settings-table.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").JobRequest} JobRequest */
/** @typedef {import("../base/types.js").Setting} Setting */
/** @typedef {import("./setting-field.js").SettingField} SettingField */

/** Settings with fields of their own kind, by name; all others have the field of their type. @type {Record<string, typeof groupsField>} */
const FIELDS = { light_groups: groupsField, background: backgroundField };

/** @param {Setting} setting */
const fieldOf = ({ name }) => FIELDS[name] ?? settingField;

/** Settings with separate fields: presets along the longer side. */
const SIZE = ["width", "height"];

/**
 * @param {Record<string, any>} defaults what the scene file asks for
 * @param {Record<string, any>} [first] what the fields show first, where that is something else; `light`: a request's
 * @param {string[]} [groups] the scene's light groups
 * @param {boolean} [isLightless] whether a studio light stands in for the scene's own
 * @param {string} [scene] its id
 * @returns {{light: HTMLElement, basic: HTMLElement[], groups: HTMLElement | undefined, advanced: HTMLElement[], get: () => Partial<JobRequest>, lightHandle: import("./environment-fields.js").LightHandle, dispose: () => void}}
 */
export function settingFields(defaults, first = {}, groups = [], isLightless = false, scene = "") {
  /** @param {Setting} setting what a request that leaves it out gets */
  const own = (setting) => defaults[setting.name] ?? setting.default;
  const fields = known()
    .settings.filter((setting) => setting.of === "job" && !SIZE.includes(setting.name))
    // Names other than those of the scene are refused, so a scene without light groups has no field.
    .filter(({ name }) => name !== "light_groups" || groups.length > 0)
    .map((setting) => fieldOf(setting)(setting, first[setting.name] ?? own(setting), () => show(), own(setting), groups));
  const ends = ["noise", "seconds"].map((name) => settingField(settingOf("work", name), first[name] ?? null));
  const environment = environmentFields(first, isLightless, scene);
  const isGroups = (/** @type {SettingField} */ { setting }) => setting.name === "light_groups"; // which is beside the switch that denoises
  const integrator = /** @type {SettingField} */ (fields.find(({ setting }) => setting.name === "integrator"));
  const show = () => {
    for (const { setting, element } of fields) setShown(element, isRead(setting, integrator.get()));
  };
  show();

  /** @param {string} name @param {SettingField[]} some */
  const elements = (name, some = fields) => some.filter(({ setting }) => setting.group === name).map(({ element }) => element);
  const sections = [...new Set(fields.map(({ setting }) => setting.section))].map((section) =>
    group(
      section,
      elements(
        "advanced",
        fields.filter((field) => field.setting.section === section && !isGroups(field)),
      ),
    ),
  );
  return {
    light: environment.element,
    basic: elements("basic"),
    groups: fields.find(isGroups)?.element,
    dispose: environment.dispose,
    lightHandle: environment.handle,
    // Settings of the group "lab" have no field: they compare what renderers do, by the API and in files.
    advanced: [
      group(
        t("Stop early"),
        ends.map(({ element }) => element),
      ),
      ...sections,
    ],
    get() {
      const changed = fields.filter(
        (field) => isRead(field.setting, integrator.get()) && String(field.get()) !== String(own(field.setting)),
      );
      const light = environment.get();
      return {
        ...Object.fromEntries([...changed, ...ends].map(({ setting, get }) => [setting.name, get()]).filter(([, v]) => v != null)),
        ...(Object.keys(light).length && { environment: light }),
      };
    },
  };
}

/** @param {string} title @param {HTMLElement[]} content */
const group = (title, content) =>
  h("fieldset", { class: "group" }, h("legend", null, title), h("div", { class: "pairs" }, content));
