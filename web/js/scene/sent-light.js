/** Fetches the lights of a preview mesh that the page does not have. The service has some only once a worker has read the scene with them. */

import { fetchPreviewLight } from "../news/api.js";
import { hasSun, isComputable, keepLight, keyOf } from "./chosen-light.js";

/** @typedef {import("../news/mesh-packet.js").MeshPacket} MeshPacket */

/** Interval and maximum duration, in milliseconds, of polling for a light. */
const [ASK_MS, ASKED_MS] = [200, 20_000];

export class SentLights {
  /** @param {string} scene its id @param {() => void} arrived called when the mesh has the light that was wanted last */
  constructor(scene, arrived) {
    this.scene = scene;
    this.arrived = arrived;
    this.asking = new AbortController();
    /** @type {MeshPacket | null} */
    this.mesh = null;
    this.wanted = "";
  }

  /** Fetches the light of a request, if the mesh needs it. @param {MeshPacket | null} mesh @param {Record<string, any>} request a view's */
  want(mesh, request) {
    const { environment = {}, variant, up, floor } = request;
    const wanted = JSON.stringify([keyOf(environment), variant, up, floor]);
    if (mesh === this.mesh && wanted === this.wanted) return;
    this.dispose();
    this.mesh = mesh;
    this.wanted = wanted;
    if (mesh && !hasSun(mesh) && keyOf(environment) && !isComputable(mesh, environment)) void this.ask(mesh, request, (this.asking = new AbortController()));
  }

  /** @param {MeshPacket} mesh @param {Record<string, any>} request @param {AbortController} asking */
  async ask(mesh, request, { signal }) {
    const until = performance.now() + ASKED_MS;
    const pause = () => new Promise((resolve) => setTimeout(resolve, ASK_MS));
    if (!request["environment"].preset) await pause(); // a worker needs as long, and a sun that is dragged is another one with each frame
    try {
      while (!signal.aborted && performance.now() < until) {
        const light = await fetchPreviewLight(this.scene, request, signal);
        if (signal.aborted) return;
        if (light) {
          keepLight(mesh, request["environment"], light);
          this.arrived();
          return;
        }
        await pause();
      }
    } catch {
      // The samples show the light.
    }
  }

  dispose() {
    this.asking.abort();
    this.mesh = null;
    this.wanted = "";
  }
}
