/** The render view: the growing picture and its tools. */

import { getJob } from "../news/api.js";
import { canDenoise } from "../job/denoise-fields.js";
import { clampExposure, displayFromUrl, displayPanel } from "../job/display-panel.js";
import { fill, h, setText } from "../base/dom.js";
import { adoptJob, denoisingAfter, jobs, scenes, workers } from "../news/farm.js";
import { lightWords, ownLight } from "../base/light-words.js";
import { emptyPage } from "../shell/hints.js";
import { icon } from "../base/icons.js";
import { actionsPanel, keepButton, progressPanel } from "../job/job-panel.js";
import { addPart, sideEdge } from "../shell/layouts.js";
import { isCurve } from "../film/curves.js";
import { jobLook } from "../film/job-look.js";
import { DEFAULT_CURVE } from "../film/tonemap.js";
import { channels } from "../film/channels.js";
import { offer } from "../news/projects.js";
import { blackNotice } from "../scene/black-notice.js";
import { doubtNotice } from "../job/doubt-notice.js";
import { queuePanel } from "../job/queue-panel.js";
import { livePicture } from "../film/live-picture.js";
import { Finishing, endedBefore, wholeProgress } from "../job/finishing.js";
import { focusTool } from "../job/focus-tool.js";
import { jobTitle, notePanel } from "../job/name-and-note.js";
import { notesPanel } from "../job/notes-panel.js";
import { verdictChip } from "../job/verdict.js";
import { stageNotices } from "../job/stage-notices.js";
import { momentsPanel } from "../job/moments-panel.js";
import { whoRendered } from "../job/who-rendered.js";
import { canMixLights, lightMixer } from "../job/light-mixer.js";
import { historyPanel } from "../job/history-panel.js";
import { logPanel } from "../job/log-panel.js";
import { histogramPanel } from "../job/histogram-panel.js";
import { explainPanel } from "../job/explain-panel.js";
import { pinsPanel } from "../job/pins.js";
import { pictureTools } from "../job/picture-tools.js";
import { asItLooks, lookQuery } from "../job/save-panel.js";
import { jobKeys, stageKeys } from "../job/render-keys.js";
import { followWithFrame, go, here, linkTo, setTitle } from "../shell/router.js";
import { sideTabs } from "../job/side-tabs.js";
import { savePanel } from "../job/save-panel.js";
import { askedBy, may, session } from "../news/session.js";
import { sharePanel } from "../job/share-panel.js";
import { isRead, known, valueText } from "../news/settings-table.js";
import { parseFrames } from "../base/frame-numbers.js";
import { renderAgain } from "../scene/render-again.js";
import { shotDesk } from "../shot/shot-desk.js";
import { isShot, shotName } from "../base/shot-words.js";
import { addShortcuts } from "../shell/shortcuts.js";
import { progressBar, stateChip, stateWord } from "../shell/state-chip.js";
import { Disposer } from "../base/store.js";
import { announce } from "../shell/tray.js";
import { removeJob } from "./job-row.js";
import { saidOf } from "../base/said.js";
import { t } from "../base/words.js";

/** @typedef {import("../base/types.js").Job} Job */

/**
 * @param {string} id
 * @returns {{element: HTMLElement, dispose: () => void}}
 */
export function jobView(id) {
  setTitle(t("Picture"));
  const life = new Disposer();
  const element = h("div", { class: "job-page" });
  /** @param {...import("../base/dom.js").Child} children */
  const instead = (...children) => fill(element, h("div", { class: "page" }, ...children));
  /** @type {((job: Job) => void) | null} */
  let update = null;
  let asked = false;
  life.add(
    jobs.subscribe((all) => {
      const job = all?.find((candidate) => candidate.id === id);
      if (job) asked = false;
      if (job) offer(element, job.project);
      if (job?.width && job.height) {
        update ??= open(element, job, life);
        update(job);
      } else if (job) {
        // Its size is the scene's, and that is not known yet.
        instead(emptyPage("clock", job.name, h("p", null, saidOf(job, job.error ? "error" : "message") || t("Waiting for its scene."))));
      } else if (all && !asked) {
        asked = true;
        getJob(id).then(adoptJob, (error) => {
          const wasThere = update !== null && error.status === 404;
          if (update && !wasThere) return; // the picture stays; the banner shows that the service does not respond
          instead(
            emptyPage(
              wasThere ? "trash" : "image",
              wasThere ? t("This picture was deleted") : t("This picture is not here"),
              !wasThere && h("p", null, error.status === 404 ? t("It was deleted, or its address is incomplete.") : error.message),
              h("a", { href: linkTo("jobs") }, t("To the jobs")),
            ),
          );
        });
      }
    }),
  );
  return { element, dispose: () => life.dispose() };
}

/**
 * @param {HTMLElement} page
 * @param {Job} job of known size
 * @param {Disposer} life
 * @returns {(job: Job) => void}
 */
function open(page, job, life) {
  let latest = job;
  let isOpened = false;
  const display = displayFromUrl(job);
  const normalise = () => {
    const exposure = picture.film.normalisingExposure();
    if (exposure != null) display.update((look) => ({ ...look, exposure: clampExposure(exposure) }));
  };
  const look = displayPanel(display, job.settings, { normalise, denoise: () => picture.renew(), usual: jobLook(job).exposure });
  const asked = isShot(job) ? askedFrame(job) : undefined;
  const picture = livePicture(job, display, life, ({ left, right }) => (look.updateDenoise(right), look.updateHeat(left), isOpened && showState()), asked);
  picture.onHands(look.showHands);
  const history = historyPanel(() => latest, life);
  const moments = isShot(job) ? null : momentsPanel(() => latest, picture, display, life);
  const log = logPanel(() => latest, life);
  const shot = isShot(job) ? shotDesk(() => latest, picture, display, life) : null;
  page.classList.toggle("with-shot", shot !== null);
  const finishing = new Finishing();
  const save = savePanel(display, () => picture.live, Boolean(job.settings?.deep), () => finishing.left());
  const unsaved = h("p", { class: "side-section quiet small" }, t("Pictures can be saved after the first samples, at any time."));
  const actions = actionsPanel();
  const keep = keepButton();
  const progress = progressPanel(() => finishing.left());
  const queue = queuePanel();
  const doubt = doubtNotice();
  const title = jobTitle();
  const note = notePanel();
  progress.element.append(note.element);
  let tabBefore = "view";
  const explained = explainPanel(picture, life, moments, (isShown) => {
    const now = tabs.current();
    if (isShown && now !== "paths") tabBefore = now;
    if (isShown) tabs.offer("paths", true);
    if (isShown || now === "paths") tabs.show(isShown ? "paths" : tabBefore);
    if (!isShown) tabs.offer("paths", false);
  });
  const whose = whoRendered(() => latest, picture, life);
  const pins = pinsPanel(picture, display, life, (pin) => void explained.explain(pin), (pin) => (tabs.show("info"), log.ofTile(picture.live.frame, pin)));
  const focus = focusTool(job, picture, life);
  const tools = pictureTools(picture.element, picture.view, () => asItLooks(picture.live, display.value), [focus.button, pins.button, explained.button]);
  const notes = notesPanel(() => latest, picture, life, { open: () => tabs.show("notes"), begin: () => tools.release(), goTo: (frame) => shot?.goTo(frame) });
  const histogram = histogramPanel(picture.live, display, life);
  picture.tools.append(tools.element);
  const putAway = { keys: "Escape", does: t("Leave the tool; close the paths"), run: () => (explained.close(), tools.release()) };
  const chip = stateChip(job.state);
  const judged = verdictChip();
  const line = progressBar(t("Progress"));
  /** Seconds that its last denoised picture takes, as expected when its first samples came: the progress does not go back. @type {number | null} */
  let denoising = null;
  /** @type {string} */
  let shownState = job.state;
  let isEarlier = endedBefore(job);
  /** Shows the job's state: it is finished once its last picture is there, or if it had ended long before the page was opened. */
  const showState = () => {
    isEarlier &&= latest.state === "finished"; // more samples may be added to it
    if (latest.progress > 0) denoising ??= denoisingAfter(latest);
    finishing.update(latest.denoise === true && latest.state === "finished" && picture.awaitsLast(), denoising ?? 0);
    const isFinishing = !isEarlier && finishing.left() !== null;
    const state = isFinishing ? "finishing" : latest.state;
    if (state !== shownState) announce(`${latest.name}: ${stateWord(state)}`);
    shownState = state;
    chip.update(state);
    const isOver = latest.state === "finished" && !isFinishing;
    line.update(isOver ? 1 : wholeProgress(latest.progress, latest.active_s, denoising ?? 0, finishing.progress()), state);
    progress.tick();
  };
  life.every(1000, progress.tick);
  life.every(250, () => finishing.left() !== null && showState());

  const saveButton = save.split; // what most want of a finished picture

  const notices = stageNotices(picture.element, () => latest, picture.live, life);
  blackNotice(picture.element, () => latest, picture.live, life);
  let isDenoisedFirst = false;
  /** Shows a job that asks for it denoised at first, also while it renders. The link may ask for another picture. */
  const denoiseFirst = () => {
    if (isDenoisedFirst || here().params.has("then") || !latest.denoise || !canDenoise(workers.value)) return;
    isDenoisedFirst = true;
    save.preferDenoised();
    if (!here().params.has("denoise") && display.value.channel === "") display.update((shown) => ({ ...shown, denoise: "on" }));
  };
  life.add(
    workers.subscribe((all) => {
      look.offerDenoise(canDenoise(all));
      save.offerDenoised(canDenoise(all));
      denoiseFirst();
    }),
  );
  if (shot) save.element.append(shot.files);
  const keys = jobKeys({ job: () => latest, display, inShot: shot !== null });
  life.add(addShortcuts([...keys.picture, ...save.actions, ...title.keys, ...notes.keys, ...tools.keys, ...focus.keys, ...explained.keys, ...(moments?.keys ?? [])], "picture")); // in the palette's order
  const ofStage = stageKeys({ view: picture.view, display, normalise, usual: jobLook(job).exposure, inShot: shot !== null });
  life.add(addShortcuts([...ofStage, ...keys.view, ...pins.keys, putAway], "view"));

  const tabs = sideTabs(t("Picture"), [
    // What grows while it renders comes last.
    { name: "view", label: t("View"), content: [look.element, moments?.element, histogram, whose.element, look.outlined] },
    { name: "lights", label: t("Lights"), isOffered: canMixLights(job), content: [lightMixer(display, () => latest, life, (groups) => renderAgain(latest, { light_groups: groups.join(",") }, picture))] },
    { name: "notes", label: t("Notes"), content: [notes.element], badge: notes.badge, shown: notes.setShown },
    { name: "save", label: t("Save"), content: [save.element, unsaved, session.value.login && may("submit") && sharePanel(job, () => lookQuery(display.value))] },
    { name: "info", label: t("Info"), content: [details(job, life), queue.element, shot?.edit, history.element, log.element] },
    { name: "paths", label: t("Paths"), isOffered: false, content: [explained.element] },
  ]);
  life.add(scenes.subscribe(() => tabs.offer("lights", canMixLights(job)))); // listed after the jobs
  life.add(addPart("tab", { get: tabs.current, set: tabs.show }));
  life.add(
    addPart("display", {
      get: () => ({ exposure: display.value.exposure, curve: display.value.curve, channel: display.value.channel }),
      set({ exposure = 0, curve = "", channel = "" }) {
        const look = exposure === null ? jobLook(job) : { exposure: Number(exposure) || 0, curve: isCurve(curve) ? curve : DEFAULT_CURVE };
        display.update((now) => ({ ...now, exposure: clampExposure(look.exposure), curve: look.curve, channel: channels(job.settings).some(({ name }) => name === channel) ? channel : "" }));
      },
    }),
  );
  const side = [
    ...[progress.element, doubt.element, shot?.panel, pins.element],
    ...tabs.elements,
  ];
  const aside = h("aside", { class: "side", "aria-label": t("Picture") }, ...side);
  // On a narrow screen below the picture, which then lies where the scene's view did.
  const bar = h("div", { class: "job-bar" });
  const narrow = matchMedia("(max-width: 860px)");
  const phone = matchMedia("(max-width: 560px)"); // whose width the title needs
  const others = jobTools(() => latest);
  const head = heading(job, title.element);
  const arrange = () => {
    keep.element.classList.toggle("icon-button", !narrow.matches);
    keep.element.classList.toggle("button", narrow.matches);
    bar.append(chip.element, judged.element, actions.element);
    if (narrow.matches) actions.element.append(keep.element);
    (phone.matches ? bar : head).append(saveButton, ...others);
    if (phone.matches) picture.statusBar.before(progress.element); // the numbers come before the tools
    else aside.prepend(progress.element);
    if (narrow.matches) return;
    title.element.after(chip.element, judged.element);
    saveButton.before(actions.element);
    others.at(-1)?.before(keep.element);
  };
  for (const each of [narrow, phone]) each.addEventListener("change", arrange);
  life.add(() => [narrow, phone].forEach((each) => each.removeEventListener("change", arrange)));
  fill(
    page,
    head,
    h("div", { class: "job-line" }, line.element),
    picture.element,
    shot?.bar,
    shot?.strip,
    bar,
    picture.statusBar,
    aside,
    sideEdge(() => aside, life),
  );
  arrange();
  isOpened = true;

  return (next) => {
    save.element.hidden = next.samples === 0;
    unsaved.hidden = next.samples > 0;
    save.offer(next);
    // The buttons that go would take a line with them, and move all that is below.
    if (narrow.matches && next.state !== latest.state) bar.style.minHeight = `${bar.offsetHeight}px`;
    latest = next;
    showState();
    denoiseFirst();
    notices.update();
    setTitle(`${next.state === "running" ? `${Math.floor(next.progress * 100)} % ` : ""}${next.name}`);
    judged.update(next.review);
    for (const part of [title, note, look, picture, actions, keep, progress, doubt, queue, focus, history, moments, whose, shot, notes]) part?.update(next);
  };
}

/**
 * The heading above the picture.
 *
 * @param {Job} job
 * @param {HTMLElement} title
 */
function heading({ scene }, title) {
  const back = { class: "icon-button", href: linkTo("scenes", scene), "aria-label": t("Back to the scene"), title: t("Back to the scene") };
  return h("header", { class: "job-head" }, h("a", back, icon("back")), title, h("span", { class: "grow" }));
}

/**
 * What else is done with the job: comparing, and last deleting it.
 *
 * @param {() => Job} job the latest state
 * @returns {HTMLElement[]}
 */
function jobTools(job) {
  const compare = {
    class: "button wide-word",
    href: linkTo("compare", job().id),
    "aria-label": t("Compare with another picture"),
    title: t("Compare with another picture (C)"),
    onclick: (/** @type {Event} */ event) => followWithFrame(event, isShot(job()) ? here().params.get("frame") : null),
  };
  const remove = () => {
    removeJob(job());
    go("jobs");
  };
  const bin = { class: "icon-button danger for-submit", type: "button", "aria-label": t("Delete this picture"), title: t("Delete this picture"), onclick: remove };
  return [h("a", compare, icon("compare"), h("span", null, t("Compare"))), h("button", bin, icon("trash"))];
}

/** @param {Job} job @param {Disposer} life */
function details(job, life) {
  /** @type {[string, import("../base/dom.js").Child][]} */
  const rows = [
    [t("Scene"), sceneLink(job, life)],
    ...shotRows(job, life),
    [t("Light"), light(job, life)],
    [t("Size"), `${job.width}×${job.height}`],
    [t("Field of view"), job.settings && `${Number(job.settings.view.fov.toFixed(1))}°`],
    ...told(job.settings),
    [t("Submitted by"), askedBy(job) || null],
    [t("Job"), h("code", null, job.id)],
  ];
  return h(
    "section",
    { class: "side-section", "aria-label": t("Details") },
    h("h2", null, t("Details")),
    h(
      "a",
      { class: "button again", href: `${linkTo("scenes", job.scene)}?like=${job.id}` },
      icon("refresh"),
      t("Render with other settings"),
    ),
    h(
      "dl",
      { class: "facts number" },
      rows
        .filter(([, value]) => value != null)
        .map(([name, value]) => h("div", null, h("dt", null, name), h("dd", null, value))),
    ),
  );
}

/** A link to the scene, whose name may differ from the job's. @param {Job} job @param {Disposer} life */
function sceneLink(job, life) {
  const link = h("a", { href: linkTo("scenes", job.scene) });
  life.add(scenes.subscribe((all) => setText(link, all?.find(({ id }) => id === job.scene)?.name ?? job.name)));
  return link;
}

/** The environment light of a job. Which light is the scene's own is known once the scenes are listed. @param {Job} job @param {Disposer} life */
function light(job, life) {
  const told = h("span");
  const show = () => {
    const scene = scenes.value?.find(({ id }) => id === job.scene);
    setText(told, lightWords(job.environment, scene) || ownLight(scene));
  };
  life.add(scenes.subscribe(show));
  return told;
}

/** @param {Job} job the frame that the address names @returns {number | undefined} */
function askedFrame({ shot }) {
  const { params } = here();
  const numbers = parseFrames(shot?.frames ?? "");
  return typeof numbers === "string" ? undefined : numbers.find((number) => String(number) === params.get("frame"));
}

/** @param {Job} job @param {Disposer} life @returns {[string, import("../base/dom.js").Child][]} */
function shotRows(job, life) {
  const { shot } = job;
  if (!shot) return [];
  const name = h("span");
  // Scenes load after jobs and contain the default frame rate of a shot.
  life.add(scenes.subscribe((all) => setText(name, shotName(job, all?.find(({ id }) => id === job.scene)?.fps))));
  return [
    [t("Shot"), name],
    [t("Clip"), shot.clip],
    [t("Turntable"), shot.turntable ? t("around in {n} s", { n: shot.turntable }) : null],
  ];
}

/**
 * The basic settings of a picture, and the others that differ from their defaults. A setting that the job lacks has its default.
 *
 * @param {Record<string, any> | null} settings
 * @returns {[string, string][]}
 */
function told(settings) {
  if (!settings) return [];
  return known()
    .settings.filter(({ name, of }) => name !== "width" && name !== "height" && of !== "environment")
    .filter((setting) => isRead(setting, settings.integrator))
    .filter(({ name, group, default: usual }) => group === "basic" || String(settings[name] ?? usual) !== String(usual))
    .map((setting) => [setting.label, withUnit(setting, settings[setting.name])]);
}

/** @param {import("../base/types.js").Setting} setting @param {any} value @returns {string} */
function withUnit(setting, value) {
  const text = valueText(setting, value);
  const unit = /** @type {Record<string, string>} */ ({ "°": "°", s: " s" })[setting.unit];
  return unit && text && Number.isFinite(Number(text)) ? text + unit : text; // a fraction has its own
}
