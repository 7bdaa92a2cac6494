#!/usr/bin/env python3
"""Plays a chirp on a robot whose base is clamped and whose legs hang in the air, and writes a log for `gaitfit fit`.

Written by `gaitfit excite`. The targets are in chirp.csv beside this file.

    python play.py --dry-run              check the targets against the limits; nothing moves
    python play.py --mujoco ROBOT.xml     play them on the robot in MuJoCo, base clamped (needs the package mujoco)
    python play.py                        play them on your robot: fill in the class Robot below first

It stops with exit code 1 as soon as a limit does not hold.
"""

import argparse
import csv
import math
import pathlib
import sys
import time

# Joints, gains (N·m/rad, N·m·s/rad) and limits (rad, rad/s, N·m); None: no limit is known.
CHIRP = {}

HERE = pathlib.Path(__file__).resolve().parent
MOVE_SECONDS = 3.0  # from where the robot is to the first target


class Robot:
    """Your robot. Joints are in the order of CHIRP["joints"], with the gains CHIRP["kp"] and CHIRP["kd"]."""

    def __init__(self):
        sys.exit(f"{__file__}: fill in the class Robot with your robot's functions, or give --dry-run or --mujoco")

    def read(self):
        """Joint positions, rad, and velocities, rad/s: two lists."""
        raise NotImplementedError

    def send(self, target):
        """Sends position targets, rad, which hold until the next."""
        raise NotImplementedError

    def wait(self, seconds):
        """Waits until so many seconds after `start`, and gives the time then."""
        while True:
            now = time.monotonic() - self.begun
            if now >= seconds:
                return now
            time.sleep(min(seconds - now, 0.001))

    def start(self):
        """The time counts from here."""
        self.begun = time.monotonic()

    def stop(self):
        """Makes the robot safe: for example damping alone. It is called at the end, and whenever something is wrong."""
        raise NotImplementedError


class InMujoco(Robot):
    """The robot in MuJoCo: base clamped, no contacts, the controller at every physics step."""

    STEP = 0.0005

    def __init__(self, path, friction, armature, delay):
        import mujoco

        self.mujoco = mujoco
        spec = mujoco.MjSpec.from_file(str(path))
        for joint in list(spec.joints):
            if joint.type == mujoco.mjtJoint.mjJNT_FREE:
                spec.delete(joint)
        for key in list(spec.keys):
            spec.delete(key)
        # Nothing touches here, so meshes count for masses alone, and their files need not be there.
        for geom in [g for g in spec.geoms if g.type == mujoco.mjtGeom.mjGEOM_MESH and g.parent.explicitinertial]:
            spec.delete(geom)
        for thing in [*spec.geoms, *spec.sites]:
            thing.material = ""
        used = {geom.meshname for geom in spec.geoms}
        for asset in [*spec.materials, *spec.textures, *(mesh for mesh in spec.meshes if mesh.name not in used)]:
            spec.delete(asset)
        self.model = spec.compile()
        self.model.opt.timestep = self.STEP
        # The controller is below: the file's own motors would hold the joints at their zero.
        self.model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
        there = {self.model.joint(k).name for k in range(self.model.njnt)}
        missing = [name for name in CHIRP["joints"] if name not in there]
        if missing:
            sys.exit(f"{robot}: it has no joint {missing[0]}; the chirp is for {CHIRP['robot']}")
        joints = [self.model.joint(name) for name in CHIRP["joints"]]
        self.places = [int(joint.qposadr[0]) for joint in joints]
        self.dofs = [int(joint.dofadr[0]) for joint in joints]
        if friction is not None:
            self.model.dof_frictionloss[self.dofs] = friction
        if armature is not None:
            self.model.dof_armature[self.dofs] = armature
        self.data = mujoco.MjData(self.model)
        mujoco.mj_setConst(self.model, self.data)
        # A robot that holds its pose already.
        self.data.qpos[self.places] = first_target()
        self.target = first_target()
        # Targets on their way to the motors, with the times at which they arrive.
        self.delay, self.sent = delay, []
        self.largest = [0.0] * len(joints)

    def read(self):
        return list(self.data.qpos[self.places]), list(self.data.qvel[self.dofs])

    def send(self, target):
        self.sent.append((self.data.time + self.delay, target))

    def start(self):
        self.sent = [(time - self.data.time, target) for time, target in self.sent]
        self.data.time = 0.0

    def wait(self, seconds):
        while self.data.time < seconds - 1e-9:
            while self.sent and self.sent[0][0] < self.data.time + 1e-9:
                self.target = self.sent.pop(0)[1]
            q, dq = self.read()
            asked = torques(self.target, q, dq)
            for k, (torque, most) in enumerate(zip(asked, CHIRP["torque"])):
                self.largest[k] = max(self.largest[k], abs(torque))
                most = math.inf if most is None else most
                self.data.qfrc_applied[self.dofs[k]] = min(max(torque, -most), most)
            self.mujoco.mj_step(self.model, self.data)
        return self.data.time

    def stop(self):
        pass


def torques(target, q, dq):
    return [kp * (x - p) - kd * v for kp, kd, x, p, v in zip(CHIRP["kp"], CHIRP["kd"], target, q, dq)]


def read_targets():
    """Times and targets of chirp.csv, joints in the order of CHIRP["joints"]."""
    with open(HERE / "chirp.csv", newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        found = [(float(row["time"]), [float(row[f"qdes_{joint}"]) for joint in CHIRP["joints"]]) for row in rows]
    return [one[0] for one in found], [one[1] for one in found]


def first_target():
    return list(read_targets()[1][0])


def broken(q, dq, torque):
    """The first limit that does not hold, in words."""
    for k, joint in enumerate(CHIRP["joints"]):
        if not CHIRP["low"][k] <= q[k] <= CHIRP["high"][k]:
            return f"{joint} is at {q[k]:.3f} rad; its range is {CHIRP['low'][k]} to {CHIRP['high'][k]}"
        if not abs(dq[k]) <= CHIRP["speed"][k]:
            return f"{joint} turns with {dq[k]:.2f} rad/s; its limit is {CHIRP['speed'][k]}"
        if CHIRP["torque"][k] is not None and not abs(torque[k]) <= CHIRP["torque"][k]:
            return f"{joint} is asked for {torque[k]:.2f} N·m; its limit is {CHIRP['torque'][k]}"
    return None


def dry_run():
    """Checks the targets alone."""
    times, targets = read_targets()
    step, still = 1 / CHIRP["rate"], [0.0] * len(CHIRP["joints"])
    for k in range(len(times)):
        if abs(times[k] - k * step) > 1e-5:
            sys.exit(f"chirp.csv: sample {k} is at {times[k]} s, not at {k * step:.6f}")
        speed = [(x - y) / step for x, y in zip(targets[k], targets[max(k - 1, 0)])]
        wrong = broken(targets[k], speed, still)
        if wrong:
            sys.exit(f"chirp.csv: at {times[k]:.3f} s: {wrong}")
    moving = sum(len({row[k] for row in targets}) > 1 for k in range(len(CHIRP["joints"])))
    print(f"{len(times)} targets, {times[-1]:.2f} s, {moving} of {len(CHIRP['joints'])} joints move; all within the limits")


def play(robot, out):
    """Plays the targets, writes the log of what was played, and says what went wrong."""
    times, targets = read_targets()
    rows, wrong = [], None
    try:
        begin, _ = robot.read()
        robot.start()
        steps = round(MOVE_SECONDS * CHIRP["rate"])
        for k in range(1, steps + 1):
            part = 0.5 - 0.5 * math.cos(math.pi * k / steps)
            robot.send([a + part * (b - a) for a, b in zip(begin, targets[0])])
            robot.wait(k / CHIRP["rate"])
        robot.start()
        now = 0.0
        for k, target in enumerate(targets):
            now = robot.wait(times[k])
            q, dq = robot.read()
            wrong = broken(q, dq, torques(target, q, dq))
            if wrong:
                wrong = f"stopped at {now:.3f} s: {wrong}"
                break
            robot.send(target)
            rows.append([now, *q, *dq, *target])
    except KeyboardInterrupt:
        wrong = "stopped by hand"
    finally:
        robot.stop()
    names = ["time"] + [f"{signal}_{joint}" for signal in ("q", "dq", "qdes") for joint in CHIRP["joints"]]
    with open(out, "w", newline="\n") as file:
        file.write(f"# rate_hz = {CHIRP['rate']}\n# kp = {CHIRP['kp']}\n# kd = {CHIRP['kd']}\n{','.join(names)}\n")
        for row in rows:
            file.write(",".join(f"{value:.7g}" for value in row) + "\n")
    print(f"{len(rows)} samples in {out}")
    if wrong:
        sys.exit(wrong)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--dry-run", action="store_true", help="check the targets; nothing moves")
    parser.add_argument("--mujoco", metavar="ROBOT", help="play in MuJoCo on this robot file")
    parser.add_argument("--frictionloss", type=float, help="friction of all joints in MuJoCo, N·m [the file's]")
    parser.add_argument("--armature", type=float, help="rotor inertia of all joints in MuJoCo, kg·m² [the file's]")
    parser.add_argument("--delay", type=float, default=0.0, help="from a target to the motors in MuJoCo, s [0]")
    parser.add_argument("--out", type=pathlib.Path, default=HERE / "log.csv", help="log to write [log.csv beside this file]")
    parser.add_argument("--force", action="store_true", help="overwrite a log that is there already")
    args = parser.parse_args()
    if args.dry_run:
        return dry_run()
    for name, value in (("frictionloss", args.frictionloss), ("armature", args.armature), ("delay", args.delay)):
        if value is not None and not (math.isfinite(value) and value >= 0):
            sys.exit(f"--{name} {value}: give a number of at least 0")
    if args.delay > 0.2:
        sys.exit(f"--delay {args.delay}: give seconds, at most 0.2")
    if args.out.exists() and not args.force:
        sys.exit(f"{args.out} is there already: give another --out, or --force to overwrite it")
    if args.mujoco:
        robot = InMujoco(args.mujoco, args.frictionloss, args.armature, args.delay)
        play(robot, args.out)
        used = [torque / most for torque, most in zip(robot.largest, CHIRP["torque"]) if most]
        print(f"largest torque: {100 * max(used, default=0.0):.0f} % of a joint's limit")
        return
    play(Robot(), args.out)


if __name__ == "__main__":
    main()
