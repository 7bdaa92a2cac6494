// Meshes of robots: unpacking, normals, outlines.

/** Cosine of the largest angle between faces that are shaded as one surface. */
const ROUND = 0.8;

class Mesh {
  constructor(data) {
    const codes = new DataView(bytes(data.vertices).buffer), corners = new DataView(bytes(data.triangles).buffer);
    const count = codes.byteLength / 6;
    this.vertices = Array.from({ length: count }, (_, i) =>
      [0, 1, 2].map((k) => data.offset[k] + data.scale[k] * codes.getInt16(2 * (k * count + i), true)));
    this.faces = Array.from({ length: corners.byteLength / 6 }, (_, i) =>
      [0, 1, 2].map((k) => corners.getUint16(2 * (3 * i + k), true)));
  }

  /** Triangles as interleaved positions and normals. */
  triangles() {
    const across = this.faces.map((face) => {
      const [a, b, c] = face.map((i) => this.vertices[i]);
      return cross(subtract(b, a), subtract(c, a));
    });
    const normals = across.map(unit), about = this.vertices.map(() => []);
    this.faces.forEach((face, i) => face.forEach((corner) => about[corner].push(i)));
    const out = [];
    this.faces.forEach((face, i) => face.forEach((corner) => {
      const near = about[corner].filter((other) => dot(normals[i], normals[other]) > ROUND);
      out.push(...this.vertices[corner], ...unit(near.reduce((sum, other) => add(sum, across[other]), [0, 0, 0])));
    }));
    return out;
  }

  /** Points whose hull is nearly the mesh's: the farthest ones of many directions. */
  outline() {
    const found = new Set(), count = 64;
    for (let i = 0; i !== count; i += 1) {
      const z = 1 - 2 * (i + 0.5) / count, r = Math.sqrt(1 - z * z), turned = 2.399963 * i;
      const direction = [r * Math.cos(turned), r * Math.sin(turned), z];
      let best = 0, far = -Infinity;
      this.vertices.forEach((v, k) => { if (dot(v, direction) > far) { [best, far] = [k, dot(v, direction)]; } });
      found.add(best);
    }
    return Array.from(found, (k) => this.vertices[k]);
  }
}
