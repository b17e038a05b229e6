/** Renders a job's picture once more with some settings changed. */

import { createJob, imageUrl, thumbnailFormat } from "../news/api.js";
import { adoptJob, scenes } from "../news/farm.js";
import { keepFirstLook } from "../film/first-look.js";
import { go } from "../shell/router.js";
import { showError } from "../shell/tray.js";
import { startOfJob } from "./form-start.js";
import { settingsForm } from "./settings-form.js";
import { t } from "../base/words.js";

/** Width of the picture that is shown first, in pixels. */
const CLEAN_WIDTH = 960;

/**
 * Creates a job like another one, and opens its page, which shows the picture of the other one at first. The request is the one of
 * the scene page's form for that job.
 *
 * @param {import("../base/types.js").Job} job
 * @param {Record<string, unknown>} changes settings by name
 * @param {import("../film/live-film.js").LiveFilm} live the film of the job
 */
export async function renderAgain(job, changes, { film, frame }) {
  const scene = scenes.value?.find(({ id }) => id === job.scene);
  if (!scene) return;
  const form = settingsForm(scene, async () => {}, startOfJob({ ...job, settings: { ...job.settings, ...changes } }));
  try {
    const next = await createJob(form.request(), crypto.randomUUID?.() ?? String(Math.random()));
    const clean = job.denoise ? imageUrl({ job: job.id, frame }, thumbnailFormat(job), { width: CLEAN_WIDTH, denoise: "true" }) : "";
    keepFirstLook(next.id, { film, isSame: true, clean });
    adoptJob(next);
    go("jobs", next.id);
  } catch (error) {
    showError(t("The job could not be started"), error);
  } finally {
    form.dispose();
  }
}
