/** The page of a share link: one job's picture. The secret is in the address behind #, which browsers do not send. */

const EVERY_MS = 3000;
const OPEN = ["queued", "running", "paused"];

const WORDS = {
  en: { queued: "Queued", running: "Rendering", paused: "Paused", finished: "Finished", failed: "Failed", cancelled: "Cancelled", save: "Save PNG", none: "No picture yet.", lost: "No connection. Trying again …", frame: "Frame", until: "Link valid until", gone: "This link has expired or was withdrawn. Ask for a new one.", samples: "samples per pixel" },
  de: { queued: "Wartet", running: "Rendert", paused: "Pausiert", finished: "Fertig", failed: "Fehlgeschlagen", cancelled: "Abgebrochen", save: "PNG sichern", none: "Noch kein Bild.", lost: "Keine Verbindung. Neuer Versuch …", frame: "Frame", until: "Link gültig bis", gone: "Dieser Link ist abgelaufen oder wurde zurückgezogen. Bitten Sie um einen neuen.", samples: "Samples pro Pixel" },
  zh: { queued: "排队中", running: "渲染中", paused: "已暂停", finished: "已完成", failed: "失败", cancelled: "已取消", save: "保存 PNG", none: "尚无图像。", lost: "连接中断,正在重试……", frame: "帧", until: "链接有效期至", gone: "此链接已过期或已被撤销。请索取新链接。", samples: "每像素采样数" },
};
const language = navigator.languages.map((each) => each.slice(0, 2)).find((each) => each in WORDS) ?? "en";
const words = WORDS[language];
document.documentElement.lang = language;

const part = (id) => document.getElementById(id);
const [picture, message, slider, save] = ["picture", "message", "frame", "save"].map(part);
const secret = location.hash.slice(1);
const ask = (path) => fetch(path, { headers: { Authorization: `Bearer ${secret}` }, cache: "no-store", credentials: "omit" });

let job = null;
let shown = "";
let timer = 0;

function say(text) {
  message.hidden = !text;
  if (message.textContent !== text) message.textContent = text;
}

async function showPicture() {
  const frame = job.frames[Number(slider.value)] ?? job.frames[0];
  const version = `${frame} ${job.samples}`;
  if (!job.samples) return say(words.none);
  if (version === shown) return;
  const answer = await ask(`/api/shared/image.png?frame=${frame}`);
  if (answer.status === 409) return say(words.none); // a frame without samples
  if (!answer.ok) throw new Error(String(answer.status));
  const url = URL.createObjectURL(await answer.blob());
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
  const until = job.expires && `${words.until} ${new Date(job.expires * 1000).toLocaleString(language, { dateStyle: "medium", timeStyle: "short" })}`;
  const size = job.width && `${job.width}×${job.height}`;
  const samples = job.samples_per_pixel && `${job.samples_per_pixel} ${words.samples}`;
  part("facts").textContent = [size, samples, until].filter(Boolean).join(" · ");
  part("frames").hidden = job.frames.length < 2;
  slider.max = String(job.frames.length - 1);
  part("number").textContent = String(job.frames[Number(slider.value)]);
}

async function refresh() {
  clearTimeout(timer);
  try {
    const answer = await ask("/api/shared");
    if (answer.status === 401 || answer.status === 404) {
      picture.hidden = save.hidden = true;
      return say(words.gone);
    }
    if (!answer.ok) throw new Error(String(answer.status));
    job = await answer.json();
    show();
    await showPicture();
  } catch {
    say(words.lost);
    shown = "";
  }
  if (!job || OPEN.includes(job.state) || !shown) timer = setTimeout(refresh, EVERY_MS);
}

save.textContent = words.save;
part("frames").firstElementChild.textContent = words.frame;
slider.value = "0";
slider.addEventListener("input", () => job && (show(), void showPicture().catch(refresh)));
addEventListener("hashchange", () => location.reload());
void refresh();
