/**
 * Passes the canvas of the preview mesh on: from the upload, at whose start its programs are compiled, to the view of the scene while
 * it is prepared, and to the live view. So the mesh neither waits for a new WebGL context nor disappears in between.
 */

import { h } from "../base/dom.js";
import { MeshCanvas } from "./mesh-canvas.js";

/** A canvas for the next scene, which has drawn nothing yet. @type {MeshCanvas | null} */
let spare = null;

/** The canvas of a view that has ended, for the next view of its scene. @type {{scene: string, mesh: MeshCanvas} | null} */
let passed = null;

const created = () => new MeshCanvas(h("canvas", { class: "mesh" }));

/** Calls a function once the page has been drawn as it is now. @param {() => void} then */
const oncePainted = (then) => requestAnimationFrame(() => requestAnimationFrame(then));

/** Number of views that were about to begin. */
let views = 0;

/** Begins a view once the page around it has been drawn: compiling and drawing a mesh may hold up the page for seconds. @param {() => void} begin */
export function beginView(begin) {
  views += 1;
  oncePainted(begin);
}

/** Compiles the programs of a canvas for a scene that is likely to come soon. */
export function warmMesh() {
  const before = views;
  oncePainted(() => {
    if (spare || views !== before) return;
    const mesh = (spare = created());
    mesh.compile(false);
    oncePainted(() => spare === mesh && mesh.compile(true));
  });
}

/** Returns the canvas that the scene's last view passed on, with its mesh, or one without a mesh. @param {string} scene its id */
export function takeMesh(scene) {
  const mesh = passed?.scene === scene ? passed.mesh : (spare ?? created());
  if (mesh === spare) spare = null;
  else if (mesh === passed?.mesh) passed = null;
  return mesh;
}

/** Keeps a view's canvas for a view of the same scene that follows immediately. @param {string} scene its id @param {MeshCanvas} mesh */
export function passMesh(scene, mesh) {
  passed?.mesh.dispose();
  passed = { scene, mesh };
  setTimeout(() => {
    if (passed?.mesh !== mesh) return;
    passed = null;
    mesh.dispose();
  });
}
