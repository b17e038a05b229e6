/** Compiles the programs that draw a preview mesh. */

/**
 * @param {WebGL2RenderingContext} gl
 * @param {string} vertex
 * @param {string} fragment
 * @param {WebGLProgram} [alike] a program whose attributes are at the same places
 * @returns {WebGLProgram | null} null: the driver refuses it
 */
export function programOf(gl, vertex, fragment, alike) {
  const program = gl.createProgram();
  const count = alike ? gl.getProgramParameter(alike, gl.ACTIVE_ATTRIBUTES) : 0;
  for (let i = 0; alike && i < count; i++) {
    const name = gl.getActiveAttrib(alike, i)?.name ?? "";
    gl.bindAttribLocation(program, gl.getAttribLocation(alike, name), name);
  }
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

/** Returns a function that finds a program's uniforms, and remembers them. @param {WebGL2RenderingContext} gl @param {WebGLProgram} program @returns {(name: string) => WebGLUniformLocation | null} */
export function uniformsOf(gl, program) {
  /** @type {Map<string, WebGLUniformLocation | null>} */
  const known = new Map();
  return (name) => {
    if (!known.has(name)) known.set(name, gl.getUniformLocation(program, name));
    return known.get(name) ?? null;
  };
}
