/** Pictures of the examples by the scenes opened from them, of the views with which their pages open. @type {Map<string, string>} */
export const examplePictures = new Map();
