/** Zoom and position of the picture in the URL: `at=scale,x,y`, where x and y are the picture point at the centre. */

import { here, setParams } from "../shell/router.js";

/** @typedef {import("./viewport.js").Viewport} Viewport */

const REST_MS = 400;

/**
 * Restores zoom and position from the URL, if present.
 *
 * @param {Viewport} viewport
 * @param {import("../base/store.js").Disposer} life
 * @returns {() => void} to be called when the viewport moved
 */
export function rememberPlace(viewport, life) {
  const [scale, x, y] = (here().params.get("at") ?? "").split(",").map(Number);
  if (scale && scale > 0 && Number.isFinite(x) && Number.isFinite(y)) viewport.show(scale, x ?? 0, y ?? 0);
  const path = here().path.join("/");
  /** @type {ReturnType<typeof setTimeout> | undefined} */
  let timer;
  life.add(() => clearTimeout(timer));
  return () => {
    clearTimeout(timer);
    timer = setTimeout(() => {
      if (here().path.join("/") !== path) return;
      const middle = viewport.middle();
      const digits = (/** @type {number} */ v) => Number(v.toPrecision(6));
      setParams({ at: viewport.fitted ? null : [viewport.scale, middle.x, middle.y].map(digits).join(",") });
    }, REST_MS);
  };
}
