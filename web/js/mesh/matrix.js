/** Matrices of 16 values, column by column. */

export const IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1];

/** @param {number[]} a @param {number[]} b @returns {number[]} */
export function product(a, b) {
  return b.map((_, i) => [0, 1, 2, 3].reduce((sum, k) => sum + (a[4 * k + (i % 4)] ?? 0) * (b[4 * Math.floor(i / 4) + k] ?? 0), 0));
}

/** Returns the matrix of a translation. @param {number[]} by three @param {1 | -1} [sign] */
export const translation = ([x = 0, y = 0, z = 0], sign = 1) => [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, sign * x, sign * y, sign * z, 1];

/** Returns the matrix of a scale. @param {number[]} by three */
export const scaling = ([x = 1, y = 1, z = 1]) => [x, 0, 0, 0, 0, y, 0, 0, 0, 0, z, 0, 0, 0, 0, 1];

/**
 * Returns the matrix of rotations about the axes.
 *
 * @param {number[]} degrees about X, Y and Z
 * @param {string} [order] the axis that is turned about first comes first
 */
export function rotation(degrees, order = "xyz") {
  return [...order].reduce((matrix, axis) => {
    const at = "xyz".indexOf(axis);
    const [i, j] = [(at + 1) % 3, (at + 2) % 3];
    const radians = ((degrees[at] ?? 0) * Math.PI) / 180;
    const turn = [...IDENTITY];
    turn[5 * i] = turn[5 * j] = Math.cos(radians);
    turn[4 * i + j] = Math.sin(radians);
    turn[4 * j + i] = -Math.sin(radians);
    return product(turn, matrix);
  }, IDENTITY);
}

/** Returns the transpose, of rotations the inverse. @param {number[]} matrix */
export const transposed = (matrix) => matrix.map((_, i) => matrix[4 * (i % 4) + Math.floor(i / 4)] ?? 0);

/** Returns the cofactors of the upper left 3 by 3 values, which turn normals, column by column. @param {number[]} matrix */
export function cofactors([a = 0, b = 0, c = 0, , d = 0, e = 0, f = 0, , g = 0, h = 0, i = 0]) {
  return [e * i - f * h, f * g - d * i, d * h - e * g, c * h - b * i, a * i - c * g, b * g - a * h, b * f - c * e, c * d - a * f, a * e - b * d];
}
