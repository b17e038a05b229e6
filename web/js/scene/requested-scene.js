/** The scene and the light that the requests of a live view show, apart from the camera. */

/** The camera of a request, and the rest of it as JSON, as `sceneOf` returns it. @typedef {{view: import("../base/types.js").View, scene: string}} Requested */

/** Returns the scene and the light of a request as JSON: all of it but the camera and the size. @param {Record<string, any>} request */
export function sceneOf(request) {
  const { view: _, camera: __, width: ___, height: ____, ...others } = request; // the order of keys changes as the camera turns
  return JSON.stringify(others);
}

/** Returns a scene without its light. @param {string} scene as sceneOf returns it */
const unlit = (scene) => JSON.stringify({ ...JSON.parse(scene || "{}"), environment: undefined });

/** Returns whether two scenes differ in their light at most. @param {string} a as sceneOf returns it @param {string} b */
export const isSameUnlit = (a, b) => unlit(a) === unlit(b);

/** The first and the latest request of a view. */
export class RequestedScene {
  constructor() {
    /** Camera and size of the first request. */
    this.place = "";
    /** Scenes of the first and the latest request, as sceneOf returns them. */
    this.first = this.latest = "";
    /** The latest request. @type {Record<string, any>} */
    this.request = {};
  }

  /** @returns {import("../base/types.js").EnvironmentRequest} */
  get light() {
    return this.request["environment"] ?? {};
  }

  /** Whether the latest request differs from the first one in more than the camera. */
  get isChanged() {
    return this.latest !== this.first;
  }

  /** Takes a request. Returns whether its camera or size is not the first one's, and whether it shows something else than the one before. @param {Record<string, any>} request */
  take(request) {
    const scene = sceneOf(request);
    const place = JSON.stringify([request["view"], request["camera"], request["width"], request["height"]]);
    this.place ||= place;
    this.first ||= scene;
    const isOther = scene !== this.latest;
    this.latest = scene;
    this.request = request;
    return { isMoved: place !== this.place, isOther };
  }
}
