/** Downloads of a whole shot: as a movie, or its frames in a zip. */

import { shotUrl } from "../news/api.js";
import { setText } from "../base/dom.js";
import { downloadLink } from "../job/download-link.js";
import { row } from "../job/save-panel.js";
import { framesText } from "../base/frame-numbers.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("./shot-frames.js").ShotFrames} ShotFrames */

const FILES = /** @type {const} */ ([
  ["movie.mp4", "MP4", t("H.264, as it looks now: all frames that have samples, at the shot's speed")],
  ["movie.webm", "WebM", t("AV1, as it looks now: all frames that have samples, at the shot's speed")],
  ["frames.zip", "PNGs", t("The finished frames in a zip, as they look now"), "png"],
  ["frames.zip", "EXRs", t("The finished frames in a zip: scene-linear floats, untouched by exposure and curve"), "exr"],
]);

/** Maximum length of a frame range in a URL. */
const LONGEST = 1000;

/**
 * @param {Job} job
 * @param {import("../base/store.js").Store<import("../job/display-panel.js").Display>} display
 * @param {ShotFrames} frames
 * @param {import("../base/store.js").Disposer} life
 */
export function shotSave(job, display, frames, life) {
  const links = FILES.map(([file, name, hint, format]) => {
    const address = () => {
      const { exposure, curve } = display.value;
      const part = frames.range.value && partAddress(frames);
      /** @type {Record<string, string | number>} */
      const query = { ...(format && { format }), ...(format !== "exr" && { exposure, tonemap: curve }), ...(part && { frames: part }) };
      return shotUrl(job.id, file, query);
    };
    return downloadLink(name, hint, address, { isLarge: true });
  });
  const { element, label } = row("", links);
  element.lastElementChild?.setAttribute("class", "pair");
  life.add(
    frames.range.subscribe((range) => {
      setText(label, range ? t("Frames {frames}", { frames: partText(frames) }) : t("The whole shot"));
    }),
  );
  return element;
}

/**
 * The played range for a URL. One with many gaps is given by its ends; files contain the existing frames in between.
 *
 * @param {ShotFrames} frames
 */
function partAddress(frames) {
  const text = partText(frames);
  if (text.length < LONGEST) return text;
  const { value } = frames.numbers;
  const [from, to] = frames.part;
  const halves = value.slice(from, to + 1).some((number) => !Number.isInteger(number));
  return `${value[from]}-${value[to]}${halves ? "x0.5" : ""}`;
}

/** The played range as text. @param {ShotFrames} frames */
export function partText(frames) {
  const [from, to] = frames.part;
  return framesText(frames.numbers.value.slice(from, to + 1));
}
