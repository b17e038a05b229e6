/** Colours of workers in overlays: bright on any picture, and never the only distinction. */

const COLOURS = ["#ffb648", "#5cc8ff", "#8ee06b", "#ff86be", "#b9a4ff", "#ffe65c", "#4fe0c4", "#ff9a7a"];

/**
 * Assigns colours in the order of the workers' names, so they are the same on every page. They repeat beyond eight workers.
 *
 * @param {{name: string}[]} workers
 * @returns {Map<string, string>} by the worker's name
 */
export function workerColours(workers) {
  const names = workers.map(({ name }) => name).sort();
  return new Map(names.map((name, i) => [name, COLOURS[i % COLOURS.length] ?? "#fff"]));
}
