/** The renderer's own choices, by the names of renderer/settings.py, with a sentence each for whoever has to choose. */

/** @typedef {{name: string, label: string, hint: string}} Choice */

/** @type {Choice[]} */
export const INTEGRATORS = [
  { name: "path", label: "Path tracing", hint: "All light: direct, reflected, refracted, from wall to wall." },
  {
    name: "direct",
    label: "Direct light",
    hint: "Light that comes straight from a light; what it would bounce on to stays dark.",
  },
  {
    name: "whitted",
    label: "Whitted ray tracing",
    hint: "Direct light, mirrors and glass, as in 1980; matt walls light nothing.",
  },
  {
    name: "ao",
    label: "Ambient occlusion",
    hint: "How open each point is to its surroundings; lights and colours play no part.",
  },
];

/** @type {Choice[]} */
export const SAMPLERS = [
  { name: "sobol", label: "Sobol, Owen-scrambled", hint: "Evenly spread samples: the least noise for their number." },
  { name: "independent", label: "Independent", hint: "Plain random numbers, to compare with." },
];

/** @type {Choice[]} */
export const FILTERS = [
  { name: "blackman-harris", label: "Blackman-Harris", hint: "Smooth edges without ringing." },
  { name: "tent", label: "Tent", hint: "A little crisper." },
  { name: "box", label: "Box", hint: "Every sample counts the same within its pixel: crisp, with stairs." },
];

/** @type {Choice[]} */
export const SAMPLINGS = [
  {
    name: "mis",
    label: "Both, weighted (MIS)",
    hint: "Lights and surfaces are both sampled, each counts where it is good.",
  },
  { name: "light", label: "Lights only", hint: "Good for small lights; mirrors do not see them." },
  { name: "bsdf", label: "Surfaces only", hint: "Lights are found by chance: good for large ones and for mirrors." },
  { name: "uniform", label: "Uniform", hint: "All directions alike: the most noise, for comparison." },
  { name: "mixture", label: "Mixture", hint: "Half by the surface, half aimed at lights and marked balls: for caustics." },
];

/** @type {Choice[]} */
export const HEURISTICS = [
  { name: "power", label: "Power heuristic", hint: "The better strategy's samples count the more." },
  { name: "balance", label: "Balance heuristic", hint: "By how often either would have taken the sample." },
];

/** @type {Choice[]} */
export const LIGHT_CHOICES = [
  { name: "tree", label: "By what they give", hint: "Near, strong and facing lights are taken more often: a light tree." },
  { name: "power", label: "By power", hint: "Strong lights are taken more often, wherever they are." },
  { name: "uniform", label: "Uniform", hint: "Each as often as the others, for comparison." },
];

/** @type {Choice[]} */
export const PROJECTIONS = [
  { name: "perspective", label: "Perspective", hint: "As an eye or a lens sees." },
  { name: "orthographic", label: "Orthographic", hint: "Parallel lines stay parallel, as on a plan." },
  { name: "panorama", label: "Panorama", hint: "All around the eye, twice as wide as high." },
];

/** @type {Choice[]} */
export const MISTAKES = [
  { name: "", label: "None", hint: "Other renderers' errors, to see what each does to a picture." },
  {
    name: "light-cutoff",
    label: "Lights cut off by distance",
    hint: "Far light samples are dropped but still counted: the picture darkens.",
  },
  {
    name: "attenuation",
    label: "Attenuation twice",
    hint: "Radiance falls by the squared distance once more: the picture darkens.",
  },
];

/** What a request leaves out and no scene file says: RenderSettings' own values. */
export const DEFAULTS = {
  integrator: "path",
  sampler: "sobol",
  filter: "blackman-harris",
  sampling: "mis",
  heuristic: "power",
  light_choice: "tree",
  max_depth: 8,
  seed: 0,
  clamp_indirect: 0,
  roulette: 0,
  roulette_floor: 0,
  light_samples: 1,
  ao_distance: 0,
  ambient: [0, 0, 0],
  mistake: "",
};

/** @param {Choice[]} choices @param {string | undefined} name @returns {string | undefined} */
export const labelOf = (choices, name) => choices.find((choice) => choice.name === name)?.label ?? name;
