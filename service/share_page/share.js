/** The page of a share link: one job's picture. The secret is in the address behind #, which browsers do not send. */

import { notesPanel } from "./notes.js";
import { language, moment, words } from "./words.js";

const EVERY_MS = 3000;
/** How often the link of a picture that no longer changes is checked. */
const VALID_MS = 15_000;
/** After so long, a picture with its noise is shown until the denoised one has come. */
const NOISE_AFTER_MS = 5000;
const LOOK = ["denoise", "exposure", "tonemap", "mix"];
const OPEN = ["queued", "running", "paused"];

document.documentElement.lang = language;

const part = (id) => document.getElementById(id);
const [picture, message, slider, save] = ["picture", "message", "frame", "save"].map(part);
const [secret, query = ""] = location.hash.slice(1).split("?");
/** The look that the link's creator saw, as parameters of the service. */
const look = new URLSearchParams([...new URLSearchParams(query)].filter(([name]) => LOOK.includes(name)));
/** @param {string} path @param {{method: string, body: unknown}} [change] */
const ask = (path, { method, body } = { method: "GET", body: undefined }) =>
  fetch(path, {
    method,
    headers: { Authorization: `Bearer ${secret}`, ...(body === undefined ? {} : { "Content-Type": "application/json" }) },
    body: body === undefined ? undefined : JSON.stringify(body),
    cache: "no-store",
    credentials: "omit",
  });

let job = null;
let shown = "";
/** Version of the denoised picture that is awaited; "": none. */
let denoising = "";
let timer = 0;
let isAsking = false;
let isGone = false;
/** Null until the link is known to allow notes. */
let notes = null;
const shownFrame = () => job.frames[Number(slider.value)] ?? job.frames[0];

function say(text) {
  message.hidden = !text;
  if (message.textContent !== text) message.textContent = text;
}

async function showPicture() {
  if (!job.samples) return say(words.none);
  const [frame, version] = [shownFrame(), pictureVersion()];
  if (version === shown || version === denoising) return;
  if (!look.has("denoise")) return showAnswer(await ask(imagePath(frame)), version);
  denoising = version;
  const denoised = ask(imagePath(frame)).then((answer) => (answer.ok ? showAnswer(answer, version) : Promise.reject(answer)));
  const isHere = await Promise.race([denoised.then(() => true, () => false), new Promise((resolve) => setTimeout(resolve, NOISE_AFTER_MS, false))]);
  denoised.catch(() => {}).finally(() => denoising === version && (denoising = ""));
  if (!isHere && picture.hidden) await showAnswer(await ask(imagePath(frame, true)), version);
}

/** What changes when another picture is to be shown. */
const pictureVersion = () => `${shownFrame()} ${job.samples}`;

/** @param {number} frame @param {boolean} [isRaw] whether it has its noise although the link asks for the denoised picture */
function imagePath(frame, isRaw = false) {
  const wish = new URLSearchParams({ exposure: job.exposure, tonemap: job.tonemap, ...Object.fromEntries(look) });
  wish.set("frame", String(frame));
  if (isRaw) wish.delete("denoise");
  return `/api/shared/image.png?${wish}`;
}

/** @param {Response} answer @param {string} version of the picture, which may be of an earlier frame by now */
async function showAnswer(answer, version) {
  if (answer.status === 409) return say(words.none); // a frame without samples
  if (!answer.ok) throw new Error(String(answer.status));
  const blob = await answer.blob();
  if (!job || version.split(" ")[0] !== String(shownFrame()) || isGone) return;
  const url = URL.createObjectURL(blob);
  URL.revokeObjectURL(picture.src);
  shown = version;
  picture.src = url;
  picture.alt = job.name;
  picture.hidden = false;
  save.href = url;
  save.download = `${job.name}.png`;
  save.hidden = false;
  say("");
}

function show() {
  document.title = `${job.name} · Rayfarm`;
  part("name").textContent = job.name;
  const percent = OPEN.includes(job.state) ? ` ${Math.floor(100 * job.progress)} %` : "";
  part("state").textContent = words[job.state] + percent;
  const until = job.expires && `${words.until} ${moment(job.expires)}`;
  const size = job.width && `${job.width}×${job.height}`;
  const samples = job.samples_per_pixel && `${job.samples_per_pixel} ${words.samples}`;
  part("facts").textContent = [size, samples, until].filter(Boolean).join(" · ");
  if (size) part("stage").style.setProperty("--ratio", String(job.width / job.height));
  part("frames").hidden = job.frames.length < 2;
  slider.max = String(job.frames.length - 1);
  part("number").textContent = String(job.frames[Number(slider.value)]);
}

function showFrame(frame) {
  slider.value = String(job.frames.indexOf(frame));
  turn();
}

function turn() {
  show();
  notes?.draw();
  void showPicture().catch(refresh);
}

async function refresh() {
  clearTimeout(timer);
  if (isAsking) return;
  isAsking = true;
  try {
    const answer = await ask("/api/shared");
    if (answer.status === 401 || answer.status === 404) {
      picture.hidden = save.hidden = part("frames").hidden = part("notes").hidden = part("pins").hidden = true;
      document.body.classList.remove("with-notes");
      for (const name of ["state", "facts"]) part(name).textContent = "";
      isGone = true;
      return say(words.gone);
    }
    if (!answer.ok) throw new Error(String(answer.status));
    job = await answer.json();
    show();
    if (job.may_comment && !notes) {
      document.body.classList.add("with-notes");
      notes = notesPanel(ask, { picture, frame: shownFrame, frames: () => job.frames, show: showFrame });
      notes.onVerdict(refresh);
    }
    if (notes) part("notes").hidden = part("pins").hidden = !job.may_comment;
    await Promise.all([showPicture(), job.may_comment && notes.update(job.review)]);
  } catch {
    say(words.lost);
    shown = "";
  } finally {
    isAsking = false;
  }
  const changes = !job || OPEN.includes(job.state) || !shown || (notes && !document.hidden);
  if (changes || !document.hidden) timer = setTimeout(refresh, changes ? EVERY_MS : VALID_MS);
}

save.textContent = words.save;
part("frames").firstElementChild.textContent = words.frame;
slider.value = "0";
slider.addEventListener("input", () => job && turn());
document.addEventListener("visibilitychange", () => document.hidden || void refresh());
addEventListener("hashchange", () => location.reload());
void refresh();
