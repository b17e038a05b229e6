/** Pictures of the examples by the scenes opened from them: shown until there are better ones. @type {Map<string, string>} */
export const examplePictures = new Map();
