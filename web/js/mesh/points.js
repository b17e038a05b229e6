/** Point clouds as small octahedra, about as large as the points are apart (renderer/scene/readers/points.py has spheres). */

/** @typedef {import("./shapes.js").Shape} Shape */

/** Points that are shown: of more, every n-th, larger by the square root of n. */
const MOST_POINTS = 60_000;
/** Size of an octahedron that covers as much of the picture as the service's sphere. */
const ROUND = 1.25;
/** Points whose nearest neighbours are measured. */
const SAMPLED = 48;

const CORNERS = [1, 0, 0, 0, 1, 0, 0, 0, 1, -1, 0, 0, 0, -1, 0, 0, 0, -1];
const FACES = [0, 1, 2, 1, 3, 2, 3, 4, 2, 4, 0, 2, 1, 0, 5, 3, 1, 5, 4, 3, 5, 0, 4, 5];

/**
 * @param {Float32Array} places three values a point
 * @param {Uint8Array | null} colors sRGB, three a point
 * @returns {Shape | null} null if no point is finite
 */
export function pointShape(places, colors) {
  const finite = [];
  for (let i = 0; i < places.length / 3; i++) if (Number.isFinite((places[3 * i] ?? 0) + (places[3 * i + 1] ?? 0) + (places[3 * i + 2] ?? 0))) finite.push(i);
  if (!finite.length) return null;
  const step = Math.ceil(finite.length / MOST_POINTS);
  const shown = step > 1 ? finite.filter((_, i) => i % step === 0) : finite;
  const radius = ROUND * spacing(places, finite) * Math.sqrt(step);
  const corners = CORNERS.length / 3;
  const positions = new Float32Array(CORNERS.length * shown.length);
  const normals = new Float32Array(positions.length);
  const painted = colors && new Uint8Array(positions.length);
  const indices = new Uint32Array(FACES.length * shown.length);
  shown.forEach((point, n) => {
    for (let k = 0; k < CORNERS.length; k++) {
      const at = CORNERS.length * n + k;
      const corner = CORNERS[k] ?? 0;
      positions[at] = (places[3 * point + (k % 3)] ?? 0) + radius * corner;
      normals[at] = corner;
      if (painted) painted[at] = colors[3 * point + (k % 3)] ?? 0;
    }
    for (let k = 0; k < FACES.length; k++) indices[FACES.length * n + k] = corners * n + (FACES[k] ?? 0);
  });
  return { positions, normals, uvs: null, colors: painted, indices };
}

/** Returns the median distance from sampled points to their nearest neighbours, or else a hundredth of the cloud's size. @param {Float32Array} places @param {number[]} finite numbers of the points */
function spacing(places, finite) {
  /** @type {number[]} */
  const found = [];
  const samples = Math.min(SAMPLED, finite.length);
  let extent = 0;
  for (let n = 0; n < samples; n++) {
    const i = 3 * (finite[Math.floor((n * (finite.length - 1)) / Math.max(samples - 1, 1))] ?? 0);
    const [x, y, z] = [places[i] ?? 0, places[i + 1] ?? 0, places[i + 2] ?? 0];
    let nearest = Infinity;
    for (const other of finite) {
      const [dx, dy, dz] = [(places[3 * other] ?? 0) - x, (places[3 * other + 1] ?? 0) - y, (places[3 * other + 2] ?? 0) - z];
      const square = dx * dx + dy * dy + dz * dz;
      if (square > 0 && square < nearest) nearest = square;
      if (n === 0) extent = Math.max(extent, Math.abs(dx), Math.abs(dy), Math.abs(dz));
    }
    if (nearest < Infinity) found.push(nearest);
  }
  found.sort((a, b) => a - b);
  const [lower = 0, upper = 0] = [found[(found.length - 1) >> 1], found[found.length >> 1]];
  return Math.sqrt((lower + upper) / 2) || extent / 100 || 0.01;
}
