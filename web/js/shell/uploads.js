/** Uploads of dropped or selected files: progress cards in the tray, then the scene's page. */

import { ApiError, deleteScene, getInfo } from "../news/api.js";
import { MISSING_FILE, UNPACK, hasCode } from "../base/codes.js";
import { fill, h, setText } from "../base/dom.js";
import { adoptScene, scenes } from "../news/farm.js";
import { bytes, clock } from "../base/format.js";
import { notUploadedTitle, titleOf } from "./gather-files.js";
import { icon } from "../base/icons.js";
import { areImages, hasLight, holdLight, offerLight } from "./light-drop.js";
import { arrive } from "../news/arriving.js";
import { addEnvironment } from "../news/environments.js";
import { said } from "../base/said.js";
import { pick } from "./pick-files.js";
import { go, here } from "./router.js";
import { Card, announce, showActionNotice, showError, showUploadNotice } from "./tray.js";
import { Pace } from "./upload-pace.js";
import { keepLocal, prepareReader, readLocally } from "../news/local-mesh.js";
import { upload } from "../news/upload.js";
import { uploadSeconds } from "../news/upload-times.js";
import { filesFor, rivals, whichScene } from "./which-scene.js";
import { t } from "../base/words.js";

/** @typedef {import("./gather-files.js").NamedFile} NamedFile */
/** @typedef {import("../base/types.js").Scene} Scene */
/** @typedef {import("../news/arriving.js").Arrival} Arrival */

/** Delay without an answer after which a waiting notice is shown. */
const ANSWER_MS = 300;
/** Time without progress after which the upload is shown as stalled. */
const STALLED_MS = 15_000;

/** The way on after a refusal. */
const again = { label: t("Choose other files"), run: () => pick({ folder: false }, start) };

/** Prepares for files that are being dragged or chosen. */
export const prepare = prepareReader;

/** @param {NamedFile[]} files */
export async function start(files) {
  if (!files.length) {
    const { formats } = await getInfo();
    showError(t("Nothing to upload"), t("There was no file in what you dropped. A scene is one of {formats}.", { formats: formats.join(" ") }), { ofUpload: true });
    return;
  }
  const sent = files.map(({ file }) => file);
  const lacking = sceneThatLacks(sent);
  if (lacking) {
    await add(lacking, files);
    return;
  }
  if (areImages(sent)) {
    if (!offerLight(sent)) explainImages(sent);
    return;
  }
  const arrival = arrive(titleOf(files));
  try {
    await sendScenes(files, arrival);
  } finally {
    arrival.end();
  }
}

/**
 * Uploads each scene among the files, and opens its page if it is the only one.
 *
 * @param {NamedFile[]} files
 * @param {Arrival} arrival
 */
async function sendScenes(files, arrival) {
  const { formats, foreign, foreign_codes: codes } = await withProgressCard(titleOf(files), getInfo());
  const paths = files.map(({ path }) => path.toLowerCase());
  if (!paths.some((path) => formats.some((suffix) => path.endsWith(suffix)))) {
    for (const [suffix, advice] of Object.entries(foreign)) {
      const at = paths.findIndex((path) => path.endsWith(suffix));
      if (at < 0) continue;
      showError(t("{path} cannot be read here", { path: files[at]?.path ?? "" }), hasCode(codes?.[suffix], UNPACK) ? `${said(advice, codes?.[suffix])}.` : t("{advice}; drop the result here.", { advice: said(advice, codes?.[suffix]) }), { ofUpload: true, action: again });
      return;
    }
  }
  const mains = paths.some((path) => path.endsWith(".zip")) ? [] : rivals(files, formats);
  if (mains.length < 2) {
    const from = here().path.join();
    show(await send(files, {}, arrival), from);
    return;
  }
  const chosen = await whichScene(mains);
  for (const main of chosen) {
    const from = here().path.join();
    const scene = await send(filesFor(files, main), { main }, arrival);
    if (chosen.length === 1) show(scene, from);
  }
}

/**
 * Shows immediately that files were accepted, since a slow line is first busy with the page itself.
 *
 * @template T
 * @param {string} title
 * @param {Promise<T>} asked
 * @returns {Promise<T>}
 */
async function withProgressCard(title, asked) {
  /** @type {Card | null} */
  let card = null;
  const soon = setTimeout(() => {
    card = new Card(title, { ofUpload: true });
    card.lead.replaceWith(icon("upload"));
    fill(card.body, h("p", { class: "detail" }, t("Starts when the service responds …")));
  }, ANSWER_MS);
  try {
    return await asked;
  } finally {
    clearTimeout(soon);
    /** @type {Card | null} */ (card)?.remove();
  }
}

/**
 * Goes to an uploaded scene; if the user has opened another page meanwhile, shows a notification instead.
 *
 * @param {Scene | null} scene
 * @param {string} from where the page was when the upload began
 */
function show(scene, from) {
  if (!scene) return;
  const open = () => go("scenes", scene.id);
  if (here().path.join() === from) open();
  else showActionNotice(t("{name} is uploaded", { name: scene.name }), { label: t("Open"), run: open });
}

/**
 * Adds missing files to a scene, or replaces those of the same names.
 *
 * @param {Scene} base
 */
export function addFiles(base) {
  pick({ folder: false }, (files) => add(base, files));
}

/** @param {Scene} base @param {NamedFile[]} files */
async function add(base, files) {
  const scene = files.length ? await send(files, { base: base.id }) : null;
  if (!scene || scene.id === base.id) return;
  go("scenes", scene.id);
  if (base.status === "failed") await deleteScene(base.id); // it can never be rendered
}

/** @param {Scene} scene @returns {string[]} its messages about files that are missing */
function lackingSentences(scene) {
  const { error, warnings: codes = [] } = scene.codes ?? {};
  return [scene.error ?? "", ...scene.warnings].filter((_, i) => hasCode(i ? codes[i - 1] : error, MISSING_FILE));
}

/** Returns the open scene if it lacks each of these files. @param {File[]} files */
function sceneThatLacks(files) {
  const { path } = here();
  const scene = path[0] === "scenes" ? scenes.value?.find(({ id }) => id === path[1]) : undefined;
  const sentences = scene ? lackingSentences(scene).join(" ") : "";
  return scene && sentences && files.every(({ name }) => sentences.includes(name)) ? scene : null;
}

/**
 * Shows another scene of an upload with several.
 *
 * @param {Scene} base
 * @param {string} main its file
 */
export async function showOther(base, main) {
  const scene = await send([], { base: base.id, main });
  if (scene) go("scenes", scene.id);
}

/**
 * @param {NamedFile[]} files
 * @param {Record<string, string>} [fields] of the form, beside the files
 * @param {Arrival} [arrival] that shows its progress
 * @returns {Promise<Scene | null>} null where it was called off, or refused, which is said then
 */
async function send(files, fields = {}, arrival) {
  for (;;) {
    arrival?.begin();
    const outcome = await sendOnce(files, fields, arrival);
    if (outcome !== AGAIN) return outcome;
  }
}

/** Result of an interrupted attempt that is to be repeated. */
const AGAIN = Symbol("again");

/** @param {NamedFile[]} files @param {Record<string, string>} fields @param {Arrival} [arrival] @returns {Promise<Scene | null | typeof AGAIN>} */
async function sendOnce(files, fields, arrival) {
  const title = titleOf(files);
  const total = files.reduce((sum, { file }) => sum + file.size, 0);
  const card = new Card(title, { ofUpload: true });
  const abort = new AbortController();
  const bar = h("div");
  const track = h(
    "div",
    {
      class: "progress",
      role: "progressbar",
      "aria-label": t("Uploading {title}", { title }),
      "aria-valuemin": "0",
      "aria-valuemax": "100",
    },
    bar,
  );
  const line = h("p", { class: "detail number" }, t("Uploading {size}", { size: bytes(total) }));
  card.lead.replaceWith(icon("upload"));
  fill(card.body, track, line);
  fill(card.actions, h("button", { class: "text-button", type: "button", onclick: () => abort.abort() }, t("Cancel")));
  announce(t("Uploading {title}", { title }));
  /** @param {number} fraction */
  const show = (fraction) => {
    bar.style.transform = `scaleX(${fraction})`;
    arrival?.fraction.set(fraction);
    track.setAttribute("aria-valuenow", String(Math.round(fraction * 100)));
  };
  show(0);
  const pace = new Pace(total);
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let stalling;
  const stalled = () => setText(line, t("Nothing was sent for {n} s. It continues when the connection is back.", { n: STALLED_MS / 1000 }));
  setUnderWay(1);
  const begun = performance.now();
  const mesh = fields["base"] ? Promise.resolve(null) : readLocally(files, abort.signal, fields["main"]).catch(() => null);
  try {
    const scene = await upload(files, {
      fields,
      signal: abort.signal,
      progress: (sent, all) => {
        show(sent / Math.max(1, all));
        pace.put(sent, performance.now());
        clearTimeout(stalling);
        if (sent < all) stalling = setTimeout(stalled, STALLED_MS);
        setText(line, sent < all ? progressWords(sent, all, pace.now) : t("Storing …"));
      },
    });
    uploadSeconds.set(scene.id, (performance.now() - begun) / 1000);
    keepLocal(scene.id, mesh);
    adoptScene(scene);
    return scene;
  } catch (error) {
    if (abort.signal.aborted) return null;
    abort.abort(); // its preview too
    arrival?.end(); // until it is tried again, if it is
    const heading = notUploadedTitle(files);
    if (error instanceof ApiError && error.status === 0)
      return new Promise((resolve) => showError(heading, error, { ofUpload: true, action: { label: t("Try again"), run: () => resolve(AGAIN) } }));
    refuse(heading, error);
    return null;
  } finally {
    clearTimeout(stalling);
    setUnderWay(-1);
    card.remove();
  }
}

/** The fault of a file, and what to do about it, as the service's messages have them. A name may have ". " too, as "Hall No. 3.glb". */
const FAULT_AND_REMEDY = /^(.{12,}?)(?:\. (?=\p{Lu})|。(?=\S))(.*)$/su;

/** Shows why the service refuses an upload. @param {string} heading where the message is a single sentence @param {unknown} error */
function refuse(heading, error) {
  const [, fault = heading, remedy = error] = FAULT_AND_REMEDY.exec(error instanceof Error ? error.message : "") ?? [];
  showError(fault, remedy, { ofUpload: true, action: again });
}

/** @param {number} sent @param {number} all @param {Pace["now"]} pace */
function progressWords(sent, all, pace) {
  const far = t("{done} of {all}", { done: bytes(sent), all: bytes(all) });
  return pace ? t("{far}, {speed}/s, {time} left", { far, speed: bytes(Math.round(pace.speed)), time: clock(pace.left) }) : far;
}

let underWay = 0;

/** Counts uploads in progress, so that the browser warns before the page is closed. @param {1 | -1} more */
function setUnderWay(more) {
  underWay += more;
  if (underWay) addEventListener("beforeunload", ask);
  else removeEventListener("beforeunload", ask);
}

/** @param {BeforeUnloadEvent} event */
const ask = (event) => event.preventDefault();

/** Explains that images alone are no scene, and offers to keep one that can be an environment. @param {File[]} files */
function explainImages(files) {
  const name = files.length > 1 ? t("{name} and {n} more", { name: files[0]?.name ?? "", n: files.length - 1 }) : (files[0]?.name ?? "");
  const isLight = files.length === 1 && hasLight(files);
  const file = /** @type {File} */ (files[0]);
  const keep = () => {
    const abort = new AbortController();
    addEnvironment(file, { progress: () => {}, signal: abort.signal }).then(
      () => announce(t("{name} is now among the lights of every scene", { name })),
      (error) => refuse(t("{name} was not accepted", { name }), error),
    );
  };
  const scene = scenes.value?.find(({ status }) => status === "ready");
  const lighting = [];
  if (isLight && scene) {
    const light = () => {
      holdLight(file, scene.id);
      go("scenes", scene.id);
    };
    lighting.push({ label: t("Light “{scene}” with it", { scene: scene.name }), run: light });
  }
  if (isLight) {
    showUploadNotice(t("{name} can light a scene: open one, and drop it there.", { name }), ...lighting, { label: t("Add it to the lights"), run: keep });
    return;
  }
  showError(
    t("{name} is not a scene", { name }),
    t("Images are textures of a scene, or light it. Drop them with the scene's file, or drop one image on the page of a scene to light it."),
    { ofUpload: true, action: again },
  );
}
