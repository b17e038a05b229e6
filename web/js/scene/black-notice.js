/** A notice over a picture that is exactly black: the reason, and a link to the scene with a remedy. */

import { imageUrl } from "../news/api.js";
import { scenes } from "../news/farm.js";
import { isBlack } from "../base/black-image.js";
import { fill, h, setText } from "../base/dom.js";
import { icon } from "../base/icons.js";
import { t } from "../base/words.js";
import { linkTo } from "../shell/router.js";
import { invisibleWords } from "./scene-notices.js";
import { viewToText } from "./view-url.js";

/** @typedef {import("../base/types.js").Job} Job */

const CHECK_MS = 1000;
/** Number of requests for the reason of a picture, where they fail. */
const MOST_TRIES = 5;
/** Samples per pixel from which a black picture is explained: with fewer, light of few paths may not have been found. */
const LEAST_SPP = 4;

/**
 * @param {HTMLElement} stage where it is put
 * @param {() => Job} job the latest state
 * @param {import("../film/live-film.js").LiveFilm} live
 * @param {import("../base/store.js").Disposer} life
 */
export function blackNotice(stage, job, live, life) {
  const words = h("span");
  const remedy = h("div", { class: "row for-submit" });
  const element = h("div", { class: "stage-black", role: "status", hidden: true }, words, remedy);
  stage.append(element);
  /** Frame and samples of the film that was looked at. */
  let seen = "";
  let failures = 0;
  const look = async () => {
    const { film, frame, finished } = live;
    const key = `${frame} ${film.total}`;
    const { id, scene, samples, variant } = job();
    const of = scenes.value?.find((each) => each.id === scene);
    const nothing = of ? invisibleWords(of, !frame && variant == null) : "";
    if (key === seen || film.total < film.words.length * (finished || nothing ? 1 : LEAST_SPP)) return;
    seen = key;
    if (!film.isBlack()) return void (element.hidden = true);
    if (nothing) {
      setText(words, nothing);
      fill(remedy);
      return void (element.hidden = false);
    }
    const objects = new Image();
    objects.src = imageUrl({ job: id, frame }, "png", { aov: "object", v: samples }); // black where no surface is hit
    const isEmpty = await objects.decode().then(() => isBlack(objects), () => null);
    const isPast = key !== `${live.frame} ${live.film.total}`;
    if (isEmpty === null) failures++;
    if (isPast || (isEmpty === null && failures < MOST_TRIES)) seen = "";
    if (isPast || isEmpty === null) return;
    setText(words, isEmpty ? t("The camera sees nothing") : t("No light reaches what the camera sees"));
    const view = of?.cameras.at(-1)?.view;
    const again = `${linkTo("scenes", scene)}?like=${id}`;
    const [label, href] = isEmpty ? [t("Frame the scene"), view && `${again}&view=${viewToText(view)}`] : [t("Studio light"), `${again}&light=studio`];
    fill(remedy, href && h("a", { href }, icon(isEmpty ? "camera" : "sun"), label));
    element.hidden = false;
  };
  life.every(CHECK_MS, () => void look());
}
