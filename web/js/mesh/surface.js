/** Materials of a preview mesh as the readers of files describe them. */

/** @typedef {import("../news/mesh-packet.js").MeshMaterial} MeshMaterial */
/** @typedef {import("./shapes.js").Picture} Picture */

/** Number of a texture that a material does not have. */
export const NO_TEXTURE = -1;

/** @type {import("../news/mesh-packet.js").Sampler} */
export const REPEAT = { wrap_s: "repeat", wrap_t: "repeat", nearest: false };

/** Axis and cone of a lamp that shines in all directions. @type {{axis: import("./shapes.js").Vec3, cosines: [number, number]}} */
export const OMNI = { axis: [0, 0, 0], cosines: [-2, -1] };

/** A diffuse surface. @type {MeshMaterial} */
export const MATT = {
  ...{ metallic: 0, roughness: 1, f0: [0, 0, 0], transmission: 0, ior: 1.5, thin: false, coat: 0, coat_roughness: 0, emission: [0, 0, 0] },
  ...{ unlit: false, alpha_mode: "opaque", cutoff: 0.5 },
  ...{ texture: NO_TEXTURE, metallic_roughness_texture: NO_TEXTURE, emission_texture: NO_TEXTURE },
};

/** Returns the reflectance at normal incidence of a dielectric. @param {number} [ior] @param {number[]} [tint] @param {number} [level] @returns {import("./shapes.js").Vec3} */
export function dielectric(ior = 1.5, tint = [1, 1, 1], level = 1) {
  const schlick = ((ior - 1) / (ior + 1)) ** 2;
  return /** @type {import("./shapes.js").Vec3} */ (tint.map((value) => Math.min(schlick * value, 1) * level));
}

/** Returns the roughness of a GGX surface that is about as glossy as one by Phong: alpha^2 = 2 / (n + 2). Source: Walter et al. 2007. @param {number} exponent */
export const phongRoughness = (exponent) => Math.min(1, (2 / (Math.max(exponent, 0) + 2)) ** 0.25);

/** Numbers the pictures of a mesh. */
export class Pictures {
  constructor() {
    /** @type {Picture[]} */
    this.all = [];
  }

  /** @param {Picture | null | undefined} picture @returns {number} NO_TEXTURE for none */
  numberOf(picture) {
    if (!picture) return NO_TEXTURE;
    const known = this.all.indexOf(picture);
    return known < 0 ? this.all.push(picture) - 1 : known;
  }
}
