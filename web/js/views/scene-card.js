/** A scene's card on the front page. */

import { cardPicture, perPixel } from "../film/job-look.js";
import { examplePictures } from "../news/example-pictures.js";
import { deleteScene, posterUrl, thumbnailUrl } from "../news/api.js";
import { h, setFacts, setText } from "../base/dom.js";
import { jobs, putScene, scenes, setHidden } from "../news/farm.js";
import { ago, compact } from "../base/format.js";
import { icon } from "../base/icons.js";
import { holdOnLongPress } from "../shell/long-press.js";
import { linkTo } from "../shell/router.js";
import { markBlack } from "../base/black-image.js";
import { offer } from "../news/projects.js";
import { keepShownImage, shownImage } from "../news/shown-images.js";
import { lightOf, variantOf } from "../base/scene-version.js";
import { progressBar, stateChip } from "../shell/state-chip.js";
import { showError, undoable } from "../shell/tray.js";
import { saidApart } from "../base/said.js";
import { invisibleWords } from "../scene/scene-notices.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */
/** @typedef {import("../base/types.js").Scene} Scene */

/**
 * @param {Scene} scene
 * @returns {import("../base/dom.js").Row<Scene>}
 */
export function sceneCard(scene) {
  const name = h("a", { class: "name", href: linkTo("scenes", scene.id) });
  const chip = stateChip(scene.status);
  const facts = h("span", { class: "quiet small number facts-line" });
  const why = h("span", { class: "quiet small why" });
  const picture = thumbnail();
  let latest = scene;
  const remove = h(
    "button",
    { class: "icon-button danger delete for-submit", type: "button", onclick: () => removeScene(latest) },
    icon("trash"),
  );
  const element = h(
    "li",
    { class: "card" },
    picture.element,
    h("div", { class: "body" }, name, h("div", { class: "row" }, chip.element, facts), why),
    remove,
  );
  holdOnLongPress(element);
  return {
    element,
    update(next) {
      latest = next;
      offer(element, next.project);
      setText(name, next.name);
      name.title = next.name;
      remove.setAttribute("aria-label", t("Delete {name}", { name: next.name }));
      chip.update(next.status);
      chip.element.hidden = next.status === "ready";
      setFacts(facts, next.status === "ready" ? shortFacts(next) : []);
      setText(why, next.status === "failed" ? saidApart(next, "error")[0] : "");
      picture.update(next, renderedOf(next) ?? (examplePictures.get(next.id) || posterUrl(next)));
    },
  };
}

/**
 * The card of an upload in progress.
 *
 * @param {import("../news/arriving.js").Arriving} upload
 * @returns {import("../base/dom.js").Row<unknown>}
 */
export function arrivingCard({ name, fraction }) {
  const bar = progressBar(t("Uploading {title}", { title: name }));
  const word = h("span", { class: "quiet small" });
  fraction.subscribe((done) => {
    setText(word, done < 1 ? t("Uploading") : t("Storing …"));
    bar.update(done < 1 ? done : null); // how long it takes is not known
  }); // both end with the upload
  const element = h(
    "li",
    { class: "card arriving" },
    h("div", { class: "picture" }, icon("upload")),
    h("div", { class: "body" }, h("span", { class: "name", title: name }, name), h("div", { class: "row" }, word, bar.element)),
  );
  return { element, update: () => {} };
}

/** Samples per pixel from which a job's picture, which may have its noise, is clearer than a poster or the picture of an example. */
const CLEAR_SPP = 64;

/**
 * The finished picture of a scene in its own light that has the most samples; of several, the latest. Better than a thumbnail, and with
 * CLEAR_SPP samples than a poster or the picture of an example.
 * @param {Scene} scene
 * @returns {string | undefined}
 */
function renderedOf(scene) {
  const least = posterUrl(scene) || examplePictures.has(scene.id) ? CLEAR_SPP : 0;
  const asUploaded = (/** @type {Job} */ job) => !job.environment && job.variant == null && job.up == null && job.floor == null;
  const found = (jobs.value ?? []).filter((each) => each.scene === scene.id && each.state === "finished" && each.samples > 0 && perPixel(each) >= least && asUploaded(each));
  const quality = (/** @type {Job} */ { samples, shot }) => samples / Math.max(shot?.count ?? 1, 1);
  const job = found.toSorted((a, b) => quality(b) - quality(a))[0];
  return job && cardPicture(job);
}

/** @param {Scene} scene @returns {string[]} */
function shortFacts(scene) {
  const { counts } = scene;
  const parts = [variantOf(scene), lightOf(scene)].filter(Boolean);
  if (counts.triangles) parts.push(counts.triangles === 1 ? t("1 triangle") : t("{n} triangles", { n: compact(counts.triangles) }));
  if (counts.spheres) parts.push(tn(counts.spheres, "{n} sphere", "{n} spheres"));
  if (counts.textures) parts.push(tn(counts.textures, "{n} texture", "{n} textures"));
  const end = Math.max(0, ...(scene.clips ?? []).map((clip) => clip.end));
  if (end) parts.push(t("{n} s of animation", { n: Number(end.toFixed(1)) }));
  if (scenes.value?.some(({ id, name }) => name === scene.name && id !== scene.id)) parts.push(ago(scene.created));
  return parts;
}

/** A scene's thumbnail, or a placeholder until it exists. */
export function thumbnail() {
  const element = h("div", { class: "picture" }, icon("cube"));
  let shown = "";
  let reason = "";
  /** @param {string} url @param {string} instead shown if there is no picture at `url` */
  const show = (url, instead) => {
    if (!url) return;
    const known = shownImage(url);
    const image = known ?? h("img", { src: url, alt: "", loading: "lazy" });
    /** Removes the pictures before it, which stay until the new one can be seen; a later one that still loads stays too. */
    const replace = () => {
      if (!image.isConnected) return;
      while (image.previousElementSibling instanceof HTMLImageElement) image.previousElementSibling.remove();
      image.classList.add("loaded");
      markBlack(element, image, reason);
      keepShownImage(url, image);
    };
    element.append(image);
    if (known) return replace();
    image.addEventListener("load", () => image.decode().then(replace, replace), { once: true });
    image.addEventListener("error", () => (image.remove(), url === shown && show(instead, "")), { once: true });
  };
  return {
    element,
    /**
     * @param {Scene} scene
     * @param {string} [better] URL of a better picture of it, rendered by a job or shipped with an example; "" or none for the thumbnail
     */
    update(scene, better) {
      reason = invisibleWords(scene);
      const own = scene.thumbnail ? thumbnailUrl(scene.id) : "";
      const url = better || own;
      if (url === shown) return;
      shown = url;
      show(shown, own === shown ? "" : own);
    },
  };
}

/**
 * Hides a scene now and deletes it when undoing is no longer possible.
 *
 * @param {Scene} scene
 */
export function removeScene(scene) {
  setHidden(scene.id, true);
  undoable(t("“{name}” deleted", { name: scene.name }), {
    undo: () => setHidden(scene.id, false),
    commit: () =>
      void deleteScene(scene.id).catch((error) => {
        setHidden(scene.id, false);
        putScene(scene);
        showError(t("“{name}” was not deleted", { name: scene.name }), error);
      }),
  });
}
