/** Pictures of the examples that this page opened, by scene: shown until the scene is ready. @type {Map<string, string>} */
export const examplePictures = new Map();
