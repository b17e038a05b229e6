/** Duration of each upload made by this page, in seconds, by scene. @type {Map<string, number>} */
export const uploadSeconds = new Map();
