// From the packed data to poses: unpacking, blending of frames, and forward kinematics.

function bytes(text) {
  return Uint8Array.from(atob(text), (c) => c.charCodeAt(0));
}

class Robot {
  constructor(data, dt) {
    this.name = data.name;
    this.dt = dt;
    this.frames = data.frames;
    this.feet = data.feet;
    this.bodies = data.bodies.map((b) => ({
      ...b,
      quaternion: unit(b.quaternion),
      joint: b.joint && { ...b.joint, axis: unit(b.joint.axis) },
    }));
    this.geoms = data.geoms.map((g) => ({ ...g, quaternion: unit(g.quaternion) }));
    // How far a body is from the base, for its colour.
    this.depth = [];
    this.bodies.forEach((b) => this.depth.push(b.parent === -1 ? 0 : this.depth[b.parent] + 1));
    this.jointCount = data.joints;
    this.channelCount = data.offset.length;
    this.contacts = bytes(data.contacts);
    const codes = new DataView(bytes(data.motion).buffer);
    this.motion = new Float32Array(this.channelCount * this.frames);
    for (let c = 0, i = 0; c !== this.channelCount; c += 1) {
      for (let f = 0; f !== this.frames; f += 1, i += 1) {
        this.motion[i] = data.offset[c] + data.scale[c] * codes.getInt16(2 * i, true);
      }
    }
    this.stretches = this.feet.map((_, foot) => this.touching(foot));
    this.follow = [0, 1, 2].map((c) => this.smoothed(c, Math.round(0.4 / dt)));
    this.ground = data.ground ? new Ground(data.ground) : null;
    this.reach = this.extent();
    this.height = 0.9 * this.motion.subarray(2 * this.frames, 3 * this.frames).reduce((sum, z) => sum + z, 0) / this.frames;
  }

  /** Distance from the base to the farthest geom's centre, m. */
  extent() {
    const state = this.at(0), poses = this.poses(state);
    const far = ({ body, position }) =>
      Math.hypot(...subtract(add(poses[body].position, rotate(poses[body].quaternion, position)), state.position));
    return Math.max(0.05, ...this.geoms.map(far).filter(Number.isFinite));
  }

  get duration() { return (this.frames - 1) * this.dt; }

  /** Times from and to which a foot touches the ground. */
  touching(foot) {
    const list = [];
    for (let f = 0; f !== this.frames; f += 1) {
      if (this.contacts[f * this.feet.length + foot] !== 1) { continue; }
      const last = list[list.length - 1], from = f * this.dt, to = Math.min(from + this.dt, this.duration);
      if (last && last.next === f) { last.to = to; last.next = f + 1; } else { list.push({ from, to, next: f + 1 }); }
    }
    return list;
  }

  /** A channel averaged over `reach` frames before and after, so that the camera does not shake with the robot. */
  smoothed(channel, reach) {
    const from = channel * this.frames;
    const sums = new Float64Array(this.frames + 1);
    for (let f = 0; f !== this.frames; f += 1) { sums[f + 1] = sums[f] + this.motion[from + f]; }
    return Float32Array.from({ length: this.frames }, (_, f) => {
      // As many frames on either side, or the ends would jump.
      const r = Math.min(reach, f, this.frames - 1 - f);
      return (sums[f + r + 1] - sums[f - r]) / (2 * r + 1);
    });
  }

  /** All channels at a time, blended between frames except where the base was put elsewhere. */
  at(time) {
    const exact = Math.min(Math.max(time / this.dt, 0), this.frames - 1);
    const frame = Math.floor(exact), next = Math.min(frame + 1, this.frames - 1);
    const moved = Math.hypot(...[0, 1, 2].map((c) =>
      this.motion[c * this.frames + next] - this.motion[c * this.frames + frame]));
    const share = moved > 0.5 ? 0 : exact - frame;
    const blend = (list, from) => list[from + frame] * (1 - share) + list[from + next] * share;
    const value = Array.from({ length: this.channelCount }, (_, c) => blend(this.motion, c * this.frames));
    const velocities = 7 + this.jointCount;
    const feet = this.feet.length;
    return {
      position: value.slice(0, 3),
      quaternion: unit(value.slice(3, 7)),
      joints: value.slice(7, velocities),
      command: value.slice(velocities, velocities + 3),
      velocity: value.slice(velocities + 3, velocities + 6),
      follow: this.follow.map((list) => blend(list, 0)),
      height: this.height,
      contacts: this.contacts.subarray(frame * feet, (frame + 1) * feet),
    };
  }

  /** Position and orientation of every body in the world. */
  poses(state) {
    const poses = [];
    this.bodies.forEach(({ joint, ...body }) => {
      if (body.parent === -1) {
        poses.push({ position: state.position, quaternion: state.quaternion });
        return;
      }
      const parent = poses[body.parent];
      let position = add(parent.position, rotate(parent.quaternion, body.position));
      let quaternion = product(parent.quaternion, body.quaternion);
      if (joint) {
        const by = state.joints[joint.index];
        // The anchor stays where it is.
        position = add(position, rotate(quaternion, joint.anchor));
        if (joint.slides) position = add(position, rotate(quaternion, scaled(joint.axis, by)));
        else quaternion = product(quaternion, turn(joint.axis, by));
        position = subtract(position, rotate(quaternion, joint.anchor));
      }
      poses.push({ position, quaternion });
    });
    return poses;
  }
}

/** Colours from the page's style sheet, 0 … 1 each. */
function palette() {
  const style = getComputedStyle(document.documentElement);
  const color = (name) => {
    const hex = style.getPropertyValue(name).trim().slice(1);
    return [0, 2, 4].map((i) => parseInt(hex.slice(i, i + 2), 16) / 255);
  };
  return {
    paper: color("--paper"), line: color("--scene-line"), command: color("--nominal"),
    measured: color("--fitted"), contact: color("--contact"), foot: color("--foot"),
    body: [0, 1, 2, 3].map((i) => color("--body" + i)),
  };
}

/** What to draw of a robot: shapes with position, quaternion, size and colour; casters throw a shadow. */
function shapes(robot, state, colors) {
  const list = [];
  const put = (mesh, position, quaternion, size, color, caster) =>
    list.push({ mesh, position, quaternion, size, color, caster });
  const poses = robot.poses(state);
  robot.geoms.forEach((g) => {
    const pose = poses[g.body];
    const position = add(pose.position, rotate(pose.quaternion, g.position));
    const quaternion = product(pose.quaternion, g.quaternion);
    const touches = g.foot !== -1 && state.contacts[g.foot] === 1;
    const plain = g.foot === -1 ? colors.body[Math.min(robot.depth[g.body], 3)] : colors.foot;
    const color = touches ? colors.contact : plain;
    const [r, , h] = g.size;
    if (g.shape === "mesh") {
      put("mesh" + g.mesh, position, quaternion, g.size, color, true);
    } else if (g.shape === "capsule") {
      put("cylinder", position, quaternion, g.size, color, true);
      [h, -h].forEach((z) =>
        put("sphere", add(position, rotate(quaternion, [0, 0, z])), quaternion, [r, r, r], color, true));
    } else {
      put(g.shape, position, quaternion, g.size, color, true);
    }
  });
  velocityArrows(state, colors, put, robot.reach / 0.5);
  return list;
}

/** Command and measured velocity above the base, `size` times a Go2's: straight arrows for m/s, arcs for the yaw rate. */
function velocityArrows(state, colors, put, size) {
  const yaw = turn([0, 0, 1], heading(state.quaternion));
  const above = add(state.position, [0, 0, 0.24 * size]);
  const arrow = (from, along, radius, color) => {
    const length = Math.hypot(...along);
    if (length > 0.02 * size) {
      const direction = unit(along), q = pointing(direction);
      const head = Math.min(6 * radius, length), shaft = length - head;
      put("cylinder", add(from, scaled(direction, shaft / 2)), q, [radius, radius, shaft / 2], color, false);
      put("cone", add(from, scaled(direction, shaft + head / 2)), q, [2.6 * radius, 2.6 * radius, head / 2], color, false);
    }
  };
  [[state.command, colors.command, 0], [state.velocity, colors.measured, 0.045 * size]].forEach(([v, color, lift]) => {
    const centre = add(above, [0, 0, lift]);
    arrow(centre, rotate(yaw, scaled([v[0], v[1], 0], 0.35 * size)), 0.009 * size, color);
    // An arc of the angle turned in one second, its middle ahead.
    const angle = Math.max(-2.6, Math.min(2.6, v[2]));
    if (Math.abs(angle) > 0.05) {
      const pieces = 14, radius = 0.42 * size;
      const point = (share) => add(centre, rotate(yaw, [radius * Math.cos(angle * share), radius * Math.sin(angle * share), 0]));
      for (let i = 0; i !== pieces; i += 1) {
        const a = point(i / pieces), b = point((i + 1) / pieces), along = subtract(b, a);
        if (i + 1 === pieces) { arrow(a, scaled(unit(along), 0.05 * size), 0.008 * size, color); break; }
        const q = pointing(unit(along));
        put("cylinder", scaled(add(a, b), 0.5), q, [0.007 * size, 0.007 * size, Math.hypot(...along) * 0.55], color, false);
      }
    }
  });
}
