/** Sites whose machines add up their sums before sending them. */

import { call } from "./api.js";

/** @typedef {{name: string, host: string, workers: string[], results: number, sent: number, bytes_in: number, bytes_out: number, batches_waiting: number}} Site */

/** @returns {Promise<Site[]>} */
export const getSites = () => call("GET", "/sites");
