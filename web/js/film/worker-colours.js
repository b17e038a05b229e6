/** A colour for each worker, for what lies over a picture: bright on any of them, and never the only thing that tells them apart. */

const COLOURS = ["#ffb648", "#5cc8ff", "#8ee06b", "#ff86be", "#b9a4ff", "#ffe65c", "#4fe0c4", "#ff9a7a"];

/**
 * The same for a farm's workers on every page: by the order of their names. Beyond eight they come again.
 *
 * @param {{name: string}[]} workers
 * @returns {Map<string, string>} by the worker's name
 */
export function workerColours(workers) {
  const names = workers.map(({ name }) => name).sort();
  return new Map(names.map((name, i) => [name, COLOURS[i % COLOURS.length] ?? "#fff"]));
}
