/** Compiles the programs that draw a preview mesh. */

/**
 * Features that a program has only where they are drawn, since a processor that stands in for a graphics card takes long to compile
 * them. KEPT: a projected picture. GLASS. LAMPS. COAT. MAPS: textures of roughness, metal or emission. CURVES: tone curves other than
 * the default one. SHADOWS. FLOOR: what is computed is that of the floor. MIRRORS: surfaces reflect the scene. FOLLOWED: something in
 * it is not at its bounds. BALLS: balls are in it. RECTANGLES: lamps are.
 *
 * @typedef {"SHADOWS" | "MIRRORS" | "FOLLOWED" | "BALLS" | "RECTANGLES" | "FLOOR" | "KEPT" | "GLASS" | "LAMPS" | "COAT" | "MAPS" | "CURVES"} Feature
 */

/** Returns a shader's source with these features. @param {string} source @param {Feature[]} features */
const withFeatures = (source, features) => source.replace("\n", `\n${features.map((name) => `#define ${name}\n`).join("")}`);

/**
 * @param {WebGL2RenderingContext} gl
 * @param {string} vertex
 * @param {string} fragment
 * @returns {WebGLProgram | null} null: the driver refuses it
 */
export function programOf(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [type, source] of /** @type {const} */ ([
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ])) {
    const shader = /** @type {WebGLShader} */ (gl.createShader(type));
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  return gl.getProgramParameter(program, gl.LINK_STATUS) ? program : null;
}

/** A program, and a function that finds its uniforms and remembers them. @typedef {{program: WebGLProgram, at: (name: string) => WebGLUniformLocation | null}} Linked */

/** The programs of a context, each compiled when it is first needed. */
export class Programs {
  /** @param {WebGL2RenderingContext} gl */
  constructor(gl) {
    this.gl = gl;
    /** @type {Map<string, Linked | null>} */
    this.known = new Map();
  }

  /**
   * @param {string} vertex
   * @param {string} fragment
   * @param {Feature[]} features of both shaders
   * @returns {Linked | null} null: the driver refuses it
   */
  with(vertex, fragment, features) {
    const key = [features, vertex, fragment].join("\n");
    const known = this.known.get(key);
    if (known !== undefined) return known;
    const program = programOf(this.gl, withFeatures(vertex, features), withFeatures(fragment, features));
    const linked = program && { program, at: uniformsOf(this.gl, program) };
    this.known.set(key, linked);
    return linked;
  }
}

/** @param {WebGL2RenderingContext} gl @param {WebGLProgram} program @returns {Linked["at"]} */
function uniformsOf(gl, program) {
  /** @type {Map<string, WebGLUniformLocation | null>} */
  const known = new Map();
  return (name) => {
    if (!known.has(name)) known.set(name, gl.getUniformLocation(program, name));
    return known.get(name) ?? null;
  };
}
