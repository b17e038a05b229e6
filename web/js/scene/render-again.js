/** Renders a job's picture once more with some settings changed. */

import { createJob } from "../news/api.js";
import { adoptJob, scenes } from "../news/farm.js";
import { Film } from "../film/film.js";
import { keepFirstLook } from "../film/first-look.js";
import { lookOfJob } from "../film/job-look.js";
import { go } from "../shell/router.js";
import { showError } from "../shell/tray.js";
import { startOfJob } from "./form-start.js";
import { settingsForm } from "./settings-form.js";
import { t } from "../base/words.js";

/**
 * Creates a job like another one, and opens its page, which shows the picture of the other one until its own is as good. The request is the one of
 * the scene page's form for that job.
 *
 * @param {import("../base/types.js").Job} job
 * @param {Record<string, unknown>} changes settings by name
 * @param {import("../film/live-picture.js").LivePicture} picture of the job
 */
export async function renderAgain(job, changes, { film, shown }) {
  const scene = scenes.value?.find(({ id }) => id === job.scene);
  if (!scene) return;
  const form = settingsForm(scene, async () => {}, startOfJob({ ...job, settings: { ...job.settings, ...changes } }));
  try {
    const next = await createJob({ ...form.request(), ...lookOfJob(job) }, crypto.randomUUID?.() ?? String(Math.random()));
    const { width, height, words } = shown();
    const look = new Film(width, height, words);
    look.total = film.total;
    look.isDenoised = shown() !== film;
    keepFirstLook(next.id, { film: look, isSame: true, isPrevious: true, clean: "" });
    adoptJob(next);
    go("jobs", next.id);
  } catch (error) {
    showError(t("The job could not be started"), error);
  } finally {
    form.dispose();
  }
}
