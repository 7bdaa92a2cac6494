// The scene in WebGL 2: every shape is an instance of one of four meshes, or of a robot's own.

const LIGHTS = 7;
const SHAPE_SHADER = `#version 300 es
layout(location = 0) in vec3 vertex;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec3 position;
layout(location = 3) in vec4 quaternion;  // wxyz
layout(location = 4) in vec3 size;
layout(location = 5) in vec3 color;
uniform mat4 camera;
uniform vec3 shadowLight;  // z above zero: draw the shadow that falls from there
out vec3 at;
out vec3 outward;
out vec3 paint;
vec3 turned(vec3 v) { vec3 t = 2.0 * cross(quaternion.yzw, v); return v + quaternion.x * t + cross(quaternion.yzw, t); }
void main() {
  at = position + turned(vertex * size);
  outward = turned(normal / max(size, vec3(1e-4)));
  paint = color;
  if (shadowLight.z > 0.0) { at = vec3(at.xy - shadowLight.xy / shadowLight.z * max(at.z, 0.0), 0.001); }
  gl_Position = camera * vec4(at, 1.0);
}`;
const SHAPE_PIXEL = `#version 300 es
precision highp float;
in vec3 at;
in vec3 outward;
in vec3 paint;
uniform vec3 eye;
uniform vec3 shadowLight;
uniform float shadowDepth;
out vec4 pixel;
void main() {
  if (shadowLight.z > 0.0) { pixel = vec4(0.0, 0.0, 0.0, shadowDepth); return; }
  vec3 n = normalize(outward), light = normalize(vec3(0.35, -0.45, 0.85)), view = normalize(eye - at);
  // Files may wind triangles either way.
  if (dot(n, view) < 0.0) { n = -n; }
  float sky = 0.5 + 0.5 * n.z;
  float sun = max(dot(n, light), 0.0);
  float gloss = pow(max(dot(n, normalize(light + view)), 0.0), 40.0);
  float rim = pow(1.0 - max(dot(n, view), 0.0), 3.0);
  vec3 lit = paint * (mix(0.38, 0.62, sky) + 0.62 * sun) + vec3(0.16) * gloss + vec3(0.09) * rim;
  pixel = vec4(lit, 1.0);
}`;
const GROUND_SHADER = `#version 300 es
layout(location = 0) in vec3 vertex;
uniform mat4 camera;
uniform vec2 centre;
out vec2 at;
void main() {
  at = centre + vertex.xy * 14.0;
  gl_Position = camera * vec4(at, 0.0, 1.0);
}`;
const UNEVEN_SHADER = `#version 300 es
layout(location = 0) in vec3 vertex;
layout(location = 1) in vec3 normal;
uniform mat4 camera;
out vec2 at;
flat out float light;
void main() {
  at = vertex.xy;
  light = 0.55 + 0.45 * max(dot(normal, normalize(vec3(0.35, -0.45, 0.85))), 0.0);
  gl_Position = camera * vec4(vertex, 1.0);
}`;
const GROUND_PIXEL = (light) => `#version 300 es
precision highp float;
in vec2 at;
uniform vec2 centre;
uniform vec3 paper;
uniform vec3 line;
${light ? "flat in float light;" : ""}
out vec4 pixel;
float grid(float spacing, float width) {
  vec2 cell = at / spacing, thin = fwidth(cell);
  vec2 far = abs(fract(cell - 0.5) - 0.5) / thin;
  // Lines closer than pixels would flicker.
  vec2 ink = (1.0 - smoothstep(width - 0.5, width + 0.5, far)) * (1.0 - smoothstep(0.2, 0.6, thin));
  return max(ink.x, ink.y);
}
void main() {
  float fade = 1.0 - smoothstep(2.0, 9.0, distance(at, centre));
  vec2 tile = mod(floor(at), 2.0);
  float checker = abs(tile.x - tile.y);
  float ink = max(0.85 * grid(1.0, 1.0), 0.32 * grid(0.25, 0.6)) + 0.13 * checker;
  pixel = vec4(mix(paper, line, min(ink, 1.0) * fade)${light ? " * light" : ""}, 1.0);
}`;

/** Triangles as interleaved positions and normals, of unit half lengths about the origin. */
function meshes() {
  const all = { box: [], sphere: [], cylinder: [], cone: [] };
  const circle = (i, n) => [Math.cos(2 * Math.PI * i / n), Math.sin(2 * Math.PI * i / n)];
  const quad = (out, corners, normals) =>
    [0, 1, 2, 0, 2, 3].forEach((i) => out.push(...corners[i], ...normals[i % normals.length]));
  [0, 1, 2].forEach((axis) => [1, -1].forEach((side) => {
    const place = (a, b) => { const p = [0, 0, 0]; p[axis] = side; p[(axis + 1) % 3] = a; p[(axis + 2) % 3] = b * side; return p; };
    const normal = [0, 0, 0];
    normal[axis] = side;
    quad(all.box, [place(-1, -1), place(1, -1), place(1, 1), place(-1, 1)], [normal]);
  }));
  const n = 28, rings = 14;
  for (let i = 0; i !== n; i += 1) {
    const [c0, s0] = circle(i, n), [c1, s1] = circle(i + 1, n);
    for (let k = 0; k !== rings; k += 1) {
      const [z0, r0] = circle(k, 2 * rings), [z1, r1] = circle(k + 1, 2 * rings);
      const corners = [[c0 * r1, s0 * r1, z1], [c1 * r1, s1 * r1, z1], [c1 * r0, s1 * r0, z0], [c0 * r0, s0 * r0, z0]];
      quad(all.sphere, corners, corners);
    }
    quad(all.cylinder, [[c0, s0, -1], [c1, s1, -1], [c1, s1, 1], [c0, s0, 1]], [[c0, s0, 0], [c1, s1, 0], [c1, s1, 0], [c0, s0, 0]]);
    [1, -1].forEach((z) => [[0, 0, z], [c0, s0, z], [c1, s1, z]].forEach((p) => all.cylinder.push(...p, 0, 0, z)));
    [[0, 0, 1], [c0, s0, -1], [c1, s1, -1]].forEach((p) => all.cone.push(...p, c0, s0, 0.5));
    [[0, 0, -1], [c0, s0, -1], [c1, s1, -1]].forEach((p) => all.cone.push(...p, 0, 0, -1));
  }
  return all;
}

class WebGlRenderer {
  /** `own`: the meshes of robots. */
  constructor(canvas, own) {
    const gl = canvas.getContext("webgl2", { antialias: true, stencil: true, alpha: false });
    if (!gl) { throw new Error("no WebGL 2"); }
    this.gl = gl;
    this.shape = this.program(SHAPE_SHADER, SHAPE_PIXEL, ["camera", "eye", "shadowLight", "shadowDepth"]);
    const uniforms = ["camera", "centre", "paper", "line"];
    this.ground = this.program(GROUND_SHADER, GROUND_PIXEL(false), uniforms);
    this.uneven = this.program(UNEVEN_SHADER, GROUND_PIXEL(true), uniforms);
    this.surfaces = new Map();
    this.instances = gl.createBuffer();
    this.meshes = {};
    const named = own.map((mesh, i) => ["mesh" + i, mesh.triangles()]);
    [...Object.entries(meshes()), ...named].forEach(([name, triangles]) => {
      this.meshes[name] = { array: this.vertexArray(triangles), count: triangles.length / 6 };
    });
    const plane = [[-1, -1], [1, -1], [1, 1], [-1, -1], [1, 1], [-1, 1]].flatMap((p) => [...p, 0, 0, 0, 1]);
    this.plane = this.vertexArray(plane);
    gl.enable(gl.DEPTH_TEST);
    gl.enable(gl.SCISSOR_TEST);
    gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
  }

  program(vertex, pixel, uniforms) {
    const gl = this.gl, program = gl.createProgram();
    [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, pixel]].forEach(([kind, source]) => {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    });
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS)) { throw new Error(gl.getProgramInfoLog(program)); }
    const at = {};
    uniforms.forEach((name) => { at[name] = gl.getUniformLocation(program, name); });
    return { program, at };
  }

  vertexArray(triangles) {
    const gl = this.gl, array = gl.createVertexArray();
    gl.bindVertexArray(array);
    gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
    gl.bufferData(gl.ARRAY_BUFFER, new Float32Array(triangles), gl.STATIC_DRAW);
    [0, 1].forEach((i) => {
      gl.enableVertexAttribArray(i);
      gl.vertexAttribPointer(i, 3, gl.FLOAT, false, 24, 12 * i);
    });
    return array;
  }

  /** Shapes of one mesh together, as the shader reads them. */
  batches(list) {
    return Object.keys(this.meshes).map((mesh) => {
      const own = list.filter((s) => s.mesh === mesh);
      const numbers = own.flatMap((s) => [...s.position, ...s.quaternion, ...s.size, ...s.color]);
      return { mesh: this.meshes[mesh], data: new Float32Array(numbers), count: own.length };
    }).filter((batch) => batch.count !== 0);
  }

  drawBatch({ mesh, data, count }) {
    const gl = this.gl;
    gl.bindVertexArray(mesh.array);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.instances);
    gl.bufferData(gl.ARRAY_BUFFER, data, gl.STREAM_DRAW);
    let offset = 0;
    [3, 4, 3, 3].forEach((width, i) => {
      gl.enableVertexAttribArray(2 + i);
      gl.vertexAttribPointer(2 + i, width, gl.FLOAT, false, 52, offset);
      gl.vertexAttribDivisor(2 + i, 1);
      offset += 4 * width;
    });
    gl.drawArraysInstanced(gl.TRIANGLES, 0, mesh.count, count);
  }

  /** The triangles of uneven ground, made once. */
  surface(ground) {
    if (!this.surfaces.has(ground)) {
      const triangles = ground.triangles();
      this.surfaces.set(ground, { array: this.vertexArray(triangles), count: triangles.length / 6 });
    }
    return this.surfaces.get(ground);
  }

  /** Draws one view into a rectangle (pixels from the lower left); `ground` where it is uneven. */
  draw(list, view, box, colors, ground) {
    const gl = this.gl;
    gl.viewport(...box);
    gl.scissor(...box);
    gl.clearColor(...colors.paper, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);

    const floor = ground ? this.uneven : this.ground;
    gl.useProgram(floor.program);
    gl.uniformMatrix4fv(floor.at.camera, false, view.matrix);
    gl.uniform2f(floor.at.centre, view.target[0], view.target[1]);
    gl.uniform3f(floor.at.paper, ...colors.paper);
    gl.uniform3f(floor.at.line, ...colors.line);
    if (ground) {
      const { array, count } = this.surface(ground);
      gl.bindVertexArray(array);
      gl.drawArrays(gl.TRIANGLES, 0, count);
    } else {
      gl.depthMask(false);
      gl.bindVertexArray(this.plane);
      gl.drawArrays(gl.TRIANGLES, 0, 6);
    }

    gl.useProgram(this.shape.program);
    gl.uniformMatrix4fv(this.shape.at.camera, false, view.matrix);
    gl.uniform3f(this.shape.at.eye, ...view.eye);
    // Shadows fall on level ground only.
    if (!ground) { this.drawShadows(this.batches(list.filter((s) => s.caster))); }
    gl.depthMask(true);
    gl.uniform3f(this.shape.at.shadowLight, 0, 0, 0);
    this.batches(list).forEach((batch) => this.drawBatch(batch));
  }

  /** Shadows of a few lights side by side make a soft edge; the stencil darkens a place once a light. */
  drawShadows(casters) {
    const gl = this.gl;
    gl.enable(gl.BLEND);
    gl.enable(gl.STENCIL_TEST);
    gl.disable(gl.DEPTH_TEST);
    gl.stencilOp(gl.KEEP, gl.KEEP, gl.INCR);
    gl.stencilFunc(gl.EQUAL, 0, 255);
    gl.uniform1f(this.shape.at.shadowDepth, 0.4 / LIGHTS);
    for (let i = 0; i !== LIGHTS; i += 1) {
      const a = 2 * Math.PI * i / LIGHTS;
      gl.clear(gl.STENCIL_BUFFER_BIT);
      gl.uniform3f(this.shape.at.shadowLight, 0.35 + 0.045 * Math.cos(a), -0.45 + 0.045 * Math.sin(a), 1);
      casters.forEach((batch) => this.drawBatch(batch));
    }
    gl.enable(gl.DEPTH_TEST);
    gl.disable(gl.STENCIL_TEST);
    gl.disable(gl.BLEND);
  }
}
