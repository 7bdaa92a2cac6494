// The scene on a plain canvas, for browsers without WebGL 2: outlines, the farthest shape first.

/** Corners of the convex hull of points, by Andrew's monotone chain. */
function hull(points) {
  const sorted = points.slice().sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const side = (o, a, b) => (a[0] - o[0]) * (b[1] - o[1]) - (a[1] - o[1]) * (b[0] - o[0]);
  const chain = (list) => {
    const kept = [];
    list.forEach((p) => {
      while (kept.length >= 2 && !(side(kept[kept.length - 2], kept[kept.length - 1], p) > 0)) { kept.pop(); }
      kept.push(p);
    });
    kept.pop();
    return kept;
  };
  return [...chain(sorted), ...chain(sorted.slice().reverse())];
}

/** Points of a unit mesh whose hull is its outline. */
function outline(mesh) {
  const ring = (z) => Array.from({ length: 12 }, (_, i) => [Math.cos(i * Math.PI / 6), Math.sin(i * Math.PI / 6), z]);
  if (mesh === "box") { return [0, 1, 2, 3, 4, 5, 6, 7].map((i) => [i & 1, i >> 1 & 1, i >> 2].map((b) => 2 * b - 1)); }
  if (mesh === "cylinder") { return [...ring(-1), ...ring(1)]; }
  if (mesh === "cone") { return [...ring(-1), [0, 0, 1]]; }
  return [0, 1, 2].flatMap((k) => ring(0).map((p) => [p[k], p[(k + 1) % 3], p[(k + 2) % 3]]));
}

class FlatRenderer {
  /** `own`: the meshes of robots. */
  constructor(canvas, own) {
    this.canvas = canvas;
    this.pen = canvas.getContext("2d");
    this.outlines = {};
    ["box", "sphere", "cylinder", "cone"].forEach((mesh) => { this.outlines[mesh] = outline(mesh); });
    own.forEach((mesh, i) => { this.outlines["mesh" + i] = mesh.outline(); });
  }

  draw(list, view, box, colors, ground) {
    const pen = this.pen, [left, bottom, width, height] = box;
    const top = this.canvas.height - bottom - height;
    const css = (c, shade) => "rgb(" + c.map((x) => Math.round(255 * x * shade)).join(" ") + ")";
    const pixel = (p) => {
      const [x, y, far] = project(view.matrix, p);
      return [left + (x + 1) / 2 * width, top + (1 - y) / 2 * height, far];
    };
    pen.save();
    pen.beginPath();
    pen.rect(left, top, width, height);
    pen.clip();
    pen.fillStyle = css(colors.paper, 1);
    pen.fillRect(left, top, width, height);
    if (ground) {
      this.surface(ground, view, pixel, css(colors.line, 1));
    } else {
      this.grid(view, pixel, css(colors.line, 1));
    }
    const fill = (points, style) => {
      if (!points.every((p) => p[2] > 0.05)) { return; }
      pen.fillStyle = style;
      pen.beginPath();
      hull(points).forEach((p) => pen.lineTo(p[0], p[1]));
      pen.fill();
    };
    const world = (s) => this.outlines[s.mesh].map((v) =>
      add(s.position, rotate(s.quaternion, v.map((x, i) => x * s.size[i]))));
    list.filter((s) => s.caster && !ground).forEach((s) =>
      fill(world(s).map((p) => pixel([p[0] - 0.35 * p[2], p[1] + 0.45 * p[2], 0])), css(colors.line, 0.9)));
    list.map((s) => [s, pixel(s.position)[2]]).sort((a, b) => b[1] - a[1]).forEach(([s]) => {
      fill(world(s).map(pixel), css(s.color, 0.95));
    });
    pen.restore();
  }

  surface(ground, view, pixel, style) {
    const pen = this.pen;
    pen.strokeStyle = style;
    pen.lineWidth = 1;
    pen.beginPath();
    ground.lines(view.target[0], view.target[1], 3).forEach((line) => {
      let drawn = false;
      line.map(pixel).forEach(([x, y, far]) => {
        if (far > 0.05 && drawn) { pen.lineTo(x, y); } else { pen.moveTo(x, y); }
        drawn = far > 0.05;
      });
    });
    pen.stroke();
  }

  grid(view, pixel, style) {
    const pen = this.pen, reach = 4;
    const [cx, cy] = view.target.map(Math.round);
    pen.strokeStyle = style;
    pen.lineWidth = 1;
    pen.beginPath();
    for (let i = -reach; i !== reach + 1; i += 1) {
      [[[cx + i, cy - reach, 0], [cx + i, cy + reach, 0]], [[cx - reach, cy + i, 0], [cx + reach, cy + i, 0]]].forEach((ends) => {
        const [a, b] = ends.map(pixel);
        if (a[2] > 0.05 && b[2] > 0.05) { pen.moveTo(a[0], a[1]); pen.lineTo(b[0], b[1]); }
      });
    }
    pen.stroke();
  }
}
