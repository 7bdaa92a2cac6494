// Vectors are arrays, quaternions [w, x, y, z], matrices column-major as WebGL takes them.

function add(a, b) { return [a[0] + b[0], a[1] + b[1], a[2] + b[2]]; }
function subtract(a, b) { return [a[0] - b[0], a[1] - b[1], a[2] - b[2]]; }
function scaled(a, s) { return [a[0] * s, a[1] * s, a[2] * s]; }
function dot(a, b) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
function cross(a, b) {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
function unit(a) {
  const length = Math.hypot(...a);
  return length > 0 ? a.map((x) => x / length) : a;
}

/** The rotation p followed, seen from inside, by q. */
function product(p, q) {
  return [
    p[0] * q[0] - p[1] * q[1] - p[2] * q[2] - p[3] * q[3],
    p[0] * q[1] + p[1] * q[0] + p[2] * q[3] - p[3] * q[2],
    p[0] * q[2] - p[1] * q[3] + p[2] * q[0] + p[3] * q[1],
    p[0] * q[3] + p[1] * q[2] - p[2] * q[1] + p[3] * q[0],
  ];
}

function rotate(q, v) {
  const u = [q[1], q[2], q[3]];
  const t = scaled(cross(u, v), 2);
  return add(add(v, scaled(t, q[0])), cross(u, t));
}

/** Rotation by `angle` about a unit `axis`. */
function turn(axis, angle) {
  const s = Math.sin(angle / 2);
  return [Math.cos(angle / 2), axis[0] * s, axis[1] * s, axis[2] * s];
}

/** A rotation that takes z to the unit vector `d`. */
function pointing(d) {
  if (d[2] < -0.999999) { return [0, 1, 0, 0]; }
  return unit([1 + d[2], -d[1], d[0], 0]);
}

function heading(q) {
  return Math.atan2(2 * (q[0] * q[3] + q[1] * q[2]), 1 - 2 * (q[2] * q[2] + q[3] * q[3]));
}

/** Perspective times view: from `eye` towards `target`, z up, `angle` the vertical field of view. */
function cameraMatrix(eye, target, angle, aspect, near, far) {
  const back = unit(subtract(eye, target));
  const right = unit(cross([0, 0, 1], back));
  const up = cross(back, right);
  const f = 1 / Math.tan(angle / 2);
  const a = (far + near) / (near - far), b = 2 * far * near / (near - far);
  const depth = -dot(back, eye);
  const column = (i) => [right[i] * f / aspect, up[i] * f, back[i] * a, -back[i]];
  return new Float32Array([
    ...column(0), ...column(1), ...column(2),
    -dot(right, eye) * f / aspect, -dot(up, eye) * f, depth * a + b, -depth,
  ]);
}

/** A point on the screen: x and y in −1 … 1, and its distance along the view. */
function project(m, p) {
  const row = (i) => m[i] * p[0] + m[4 + i] * p[1] + m[8 + i] * p[2] + m[12 + i];
  const w = row(3);
  return [row(0) / w, row(1) / w, w];
}
