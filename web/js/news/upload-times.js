/** Seconds that uploads took, by scene; only of this page's own. @type {Map<string, number>} */
export const uploadSeconds = new Map();
