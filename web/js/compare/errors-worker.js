/** Web worker that measures errors without blocking the page. */

import { errorsOf } from "./errors.js";

addEventListener("message", (/** @type {MessageEvent} */ { data }) => {
  const errors = errorsOf(data);
  /** @type {any} */ (self).postMessage(errors, [errors.map.buffer]);
});
