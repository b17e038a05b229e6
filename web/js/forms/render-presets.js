/** Presets of size and quality. */

import { t } from "../base/words.js";

export const SIZES = [
  { name: "small", label: t("Small"), long: 960 },
  { name: "hd", label: "HD", long: 1280 },
  { name: "full-hd", label: "Full HD", long: 1920 },
  { name: "4k", label: "4k", long: 3840 },
];

/** Each halves the noise of the one before. */
export const QUALITIES = [
  { name: "draft", label: t("Draft"), spp: 16 },
  { name: "good", label: t("Good"), spp: 64 },
  { name: "final", label: t("Final"), spp: 256 },
  { name: "finest", label: t("Finest"), spp: 1024 },
];

/** The option beside the presets. */
export const CUSTOM = "custom";

/**
 * @param {number} long the longer side, in pixels
 * @param {number} aspect width / height
 */
export function sizeOf(long, aspect) {
  return aspect >= 1
    ? { width: long, height: Math.max(1, Math.round(long / aspect)) }
    : { width: Math.max(1, Math.round(long * aspect)), height: long };
}
