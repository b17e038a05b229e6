/** Actions on jobs of a list, one or thousands; each can be undone. */

import { changeMany, restore } from "../news/job-list.js";
import { setAllHidden } from "../news/farm.js";
import { showError, undoable } from "../shell/tray.js";
import { saidOf } from "../base/said.js";
import { t, tn } from "../base/words.js";

/** @typedef {import("../news/job-list.js").Change} Change */

/**
 * @typedef {object} Deed
 * @property {string} label of its button
 * @property {string} done as in "3 jobs paused"
 * @property {import("../base/icons.js").IconName} icon
 * @property {Change} change
 */

/** @type {Deed[]} */
export const JOB_ACTIONS = [
  { label: t("Pause"), done: t("paused"), icon: "pause", change: { state: "paused", of: ["queued", "running"] } },
  { label: t("Resume"), done: t("resumed"), icon: "play", change: { state: "running", of: ["paused", "failed", "cancelled"] } },
  { label: t("Cancel"), done: t("cancelled"), icon: "stop", change: { state: "cancelled", of: ["queued", "running", "paused"] } },
];

/**
 * @param {string[]} ids
 * @param {Change} change
 * @param {string} done as in "3 jobs paused"
 */
export async function change(ids, change, done) {
  try {
    const { changed, refused } = await changeMany(ids, change);
    const first = refused[0];
    if (first) showError(tn(refused.length, "{n} job could not be {done}", "{n} jobs could not be {done}", { done }), saidOf(first, "why"));
    if (changed.length === 0) {
      if (!first) showError(t("No job was {done}", { done }), t("This cannot be done with any of the selected jobs in their present state."), { brief: true });
      return;
    }
    undoable(tn(changed.length, "{n} job {done}", "{n} jobs {done}", { done }), {
      commit: () => {},
      undo: () => void restore(changed).catch((error) => showError(t("Could not undo"), error)),
    });
  } catch (error) {
    showError(t("The jobs could not be {done}", { done }), error);
  }
}

/**
 * Hides jobs at once and deletes them when undoing is no longer possible.
 *
 * @param {string[]} ids
 * @param {string} sentence
 */
export function remove(ids, sentence = tn(ids.length, "{n} job deleted", "{n} jobs deleted")) {
  setAllHidden(ids, true);
  undoable(sentence, {
    undo: () => setAllHidden(ids, false),
    commit: () =>
      void changeMany(ids, { state: "deleted" }).catch((error) => {
        setAllHidden(ids, false);
        showError(ids.length === 1 ? t("The picture was not deleted") : t("Not all jobs were deleted"), error);
      }),
  });
}
