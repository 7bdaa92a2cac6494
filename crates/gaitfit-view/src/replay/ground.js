// Uneven ground: heights over a grid, as triangles and as lines.

class Ground {
  constructor(data) {
    Object.assign(this, { corner: data.corner, step: data.step, columns: data.columns });
    const codes = new DataView(bytes(data.heights).buffer);
    this.heights = Float32Array.from({ length: codes.byteLength / 2 }, (_, i) =>
      data.offset + data.scale * codes.getInt16(2 * i, true));
    this.rows = this.heights.length / this.columns;
  }

  /** The vertex of a column and a row; beyond the edge, the nearest one. */
  vertex(column, row) {
    const c = Math.max(0, Math.min(this.columns - 1, column)), r = Math.max(0, Math.min(this.rows - 1, row));
    return [this.corner[0] + c * this.step, this.corner[1] + r * this.step, this.heights[r * this.columns + c]];
  }

  /** Triangles with one normal each, as interleaved positions and normals. */
  triangles() {
    const out = [];
    const put = (...corners) => {
      const [a, b, c] = corners, u = subtract(b, a), v = subtract(c, a);
      const normal = unit([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]);
      corners.forEach((p) => out.push(...p, ...normal));
    };
    for (let r = 0; r !== this.rows - 1; r += 1) {
      for (let c = 0; c !== this.columns - 1; c += 1) {
        const [a, b, d, e] = [this.vertex(c, r), this.vertex(c + 1, r), this.vertex(c, r + 1), this.vertex(c + 1, r + 1)];
        // The diagonal that the physics has.
        put(a, b, e);
        put(a, e, d);
      }
    }
    return out;
  }

  /** Lines along rows and columns within `reach` of a point, each as a list of points. */
  lines(x, y, reach) {
    const every = Math.max(1, Math.round(0.2 / this.step)), fine = Math.max(1, Math.round(0.05 / this.step));
    const range = (from, count) => {
      const middle = Math.round(from / this.step), half = Math.round(reach / this.step);
      return [Math.max(0, middle - half), Math.min(count - 1, middle + half)];
    };
    const [c0, c1] = range(x - this.corner[0], this.columns), [r0, r1] = range(y - this.corner[1], this.rows);
    const all = [];
    const line = (from, to, point) => {
      const points = [];
      for (let k = from; k < to; k += fine) { points.push(point(k)); }
      points.push(point(to));
      if (points.length > 1) { all.push(points); }
    };
    for (let r = Math.ceil(r0 / every) * every; r <= r1; r += every) { line(c0, c1, (c) => this.vertex(c, r)); }
    for (let c = Math.ceil(c0 / every) * every; c <= c1; c += every) { line(r0, r1, (r) => this.vertex(c, r)); }
    return all;
  }
}
