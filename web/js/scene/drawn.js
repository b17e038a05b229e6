/** Waits for a mesh to be seen. */

/** Frames after the first drawing until it is on the page, also where the processor draws. */
const FRAMES = 2;

/**
 * Calls a function once a mesh has been drawn and is on the page; never where there is no WebGL.
 *
 * @param {import("./mesh-canvas.js").MeshCanvas} mesh
 * @param {() => void} then
 * @returns {() => void} ends the wait
 */
export function onceDrawn({ canvas }, then) {
  let frames = 0;
  let next = 0;
  const look = () => {
    if (canvas.dataset.drawn && frames++ >= FRAMES) then();
    else next = requestAnimationFrame(look);
  };
  look();
  return () => cancelAnimationFrame(next);
}
