/** An image that is dropped on the page of a scene lights it: whoever shows that scene's light takes it. */

/** @typedef {(file: File) => void} Take */

/** @type {Take | null} */
let taker = null;

/** What lights a scene where it comes alone. */
const LIGHTS = /\.(exr|hdr)$/i;
/** What also may, but is a texture in the company of a scene. */
const IMAGES = /\.(exr|hdr|png|jpe?g|tiff?|webp)$/i;

export const LIGHT_FILES = ".exr,.hdr,.png,.jpg,.jpeg,.tif,.tiff,.webp";

/** @param {Take} take @returns {() => void} ends it */
export function takeLights(take) {
  taker = take;
  return () => {
    if (taker === take) taker = null;
  };
}

/** @param {File[]} files @returns {boolean} whether these are images, and no scene */
export const areImages = (files) => files.length > 0 && files.every(({ name }) => IMAGES.test(name));

/**
 * @param {File[]} files
 * @returns {boolean} whether somebody took the one file as light
 */
export function offerLight(files) {
  const [file] = files;
  if (!taker || !file || files.length !== 1 || !IMAGES.test(file.name)) return false;
  taker(file);
  return true;
}

/** @param {File[]} files @returns {boolean} whether one of them is such an image as nothing but light is made of */
export const hasLight = (files) => files.some(({ name }) => LIGHTS.test(name));
