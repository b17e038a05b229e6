/** Which scenes had takes when this browser last saw them, so that their strip has its room before the takes are loaded. */

const KEY = "rayfarm-takes";
const MOST = 200;

/** @returns {string[]} */
function read() {
  try {
    const kept = JSON.parse(localStorage.getItem(KEY) ?? "[]");
    return Array.isArray(kept) ? kept : [];
  } catch {
    return []; // storage is blocked, or has something else
  }
}

/** @param {string} scene */
export const hadTakes = (scene) => read().includes(scene);

/** @param {string} scene @param {boolean} has */
export function noteTakes(scene, has) {
  const kept = read();
  if (kept.includes(scene) === has) return;
  try {
    localStorage.setItem(KEY, JSON.stringify(has ? [scene, ...kept].slice(0, MOST) : kept.filter((id) => id !== scene)));
  } catch {
    // Storage is blocked: the strip's room comes with the takes.
  }
}
