/** Dropped environment images: the view that shows the scene's light receives them. */

/** @typedef {(file: File) => void} Take */

/** @type {Take | null} */
let lightReceiver = null;

/** A file for the view of a scene. @type {{file: File, scene: string} | null} */
let held = null;

/** Passes a file to the next view of a scene. @param {File} file @param {string} scene its id */
export const holdLight = (file, scene) => void (held = { file, scene });

/** Images that are always an environment if dropped alone. */
const LIGHTS = /\.(exr|hdr)$/i;
/** Images that may be an environment, but are textures if dropped with a scene. */
const IMAGES = /\.(exr|hdr|png|jpe?g|tiff?|webp)$/i;

export const LIGHT_FILES = ".exr,.hdr,.png,.jpg,.jpeg,.tif,.tiff,.webp";

/** @param {Take} take @param {string} [scene] id of the scene that it lights @returns {() => void} unregisters it */
export function registerLightReceiver(take, scene) {
  lightReceiver = take;
  if (held && held.scene === scene) queueMicrotask(take.bind(null, held.file));
  held = null; // that of another scene, which the user has left, too
  return () => {
    if (lightReceiver === take) lightReceiver = null;
  };
}

/** @param {File[]} files @returns {boolean} whether these are only images, without a scene */
export const areImages = (files) => files.length > 0 && files.every(({ name }) => IMAGES.test(name));

/**
 * @param {File[]} files
 * @returns {boolean} whether the single file was passed to the registered receiver
 */
export function offerLight(files) {
  const [file] = files;
  if (!lightReceiver || !file || files.length !== 1 || !IMAGES.test(file.name)) return false;
  lightReceiver(file);
  return true;
}

/** @param {File[]} files @returns {boolean} whether one of them is an image that can only be an environment */
export const hasLight = (files) => files.some(({ name }) => LIGHTS.test(name));
