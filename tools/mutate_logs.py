"""Changes one property of a good log at a time, as CSV, npz and MCAP, and looks whether gaitfit fits it right or says no.

The log is examples/go2-demo/fit.csv, a clamped Go2 whose numbers are known. Each mutation is a fault that everyday logs
have: an order, a sign, a unit, a clock, a filter. npz and MCAP go through `gaitfit import`; MCAP holds JointState messages
of two topics, state and targets. A fit that ends with exit code 0 while a true value lies outside its interval is WRONG, and
the script then ends with 1. The delay is right if it is so for the rows in which the mutation put the targets.

Usage: python tools/mutate_logs.py [--gaitfit target/debug/gaitfit] [--formats csv,npz,mcap] [--only PATTERN]
       [--seconds 4] [--jobs 1] [--search least-squares] [--out FOLDER]      (package: numpy)
"""

import argparse
import concurrent.futures
import copy
import fnmatch
import json
import pathlib
import struct
import subprocess
import sys
import tempfile

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parent.parent
TRUTH = {
    "frictionloss_hip": 0.21, "frictionloss_thigh": 0.17, "frictionloss_calf": 0.62,
    "armature_hip": 0.015, "armature_thigh": 0.019, "armature_calf": 0.047,
    "damping_hip": 0.19, "damping_thigh": 0.22, "damping_calf": 0.31, "delay": 0.007,
}
CONFIGURATION = """name = "{name}"
runs = "{runs}"
robot = "{robot}"
logs = ["{log}"]
[gains]
kp = {{ "*_hip" = {kp[0]}, "*_thigh" = {kp[1]}, "*_calf" = {kp[2]} }}
kd = {{ "*_hip" = {kd[0]}, "*_thigh" = {kd[1]}, "*_calf" = {kd[2]} }}
[[parameter]]
kind = "frictionloss"
upper = 1.5
[[parameter]]
kind = "armature"
upper = 0.2
[[parameter]]
kind = "damping"
[[parameter]]
kind = "delay"
per = "all"
upper = 0.05
[simulation]
timestep = 0.00125
[optimizer]
method = "{search}"
generations = {generations}
seeds = 1
tolerance = 5e-3
"""
JOINT_STATE = (
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n"
    + "=" * 80 + "\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n"
    + "=" * 80 + "\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
)


class Log:
    """Rows of a recording: times (n), positions, velocities and targets (n, joints), and what a file says besides."""

    def __init__(self, seconds):
        lines = (ROOT / "examples/go2-demo/fit.csv").read_text().splitlines()
        rows = [line.split(",") for line in lines if line and not line.startswith("#")]
        self.joints = [name[2:] for name in rows[0] if name.startswith("q_")]
        table = np.array(rows[1:], dtype=float)
        table = table[table[:, 0] < seconds]
        count = len(self.joints)
        self.time = table[:, 0]
        self.q, self.dq, self.target = (table[:, 1 + k * count : 1 + (k + 1) * count].copy() for k in range(3))
        self.rate = 200
        self.kp, self.kd = [20.0, 20.0, 40.0], [1.0, 1.0, 2.0]
        self.gains = True
        self.truth = dict(TRUTH)
        # The time of each target's own stamp, s after its row; only MCAP has one.
        self.lead = 0.0
        self.lead_jitter = 0.0
        # Changes of a file rather than of the recording.
        self.columns = None
        self.blank = False
        self.float32_time = False
        self.zeros_topic = False
        self.names = True
        self.no_velocity = False
        self.stamped = True

    def at(self, pattern):
        return [k for k, joint in enumerate(self.joints) if fnmatch.fnmatch(joint, pattern)]

    def rows(self, kept):
        self.time = self.time[kept]
        self.q, self.dq, self.target = self.q[kept], self.dq[kept], self.target[kept]


MUTATIONS = {}


def mutation(*formats):
    """Registers a function that changes a log; `formats`: those in which the fault exists, all without one."""

    def register(function):
        MUTATIONS[function.__name__] = (function, formats or ("csv", "npz", "mcap"))
        return function

    return register


def swap(log, first, second, signals):
    for signal in signals:
        values = getattr(log, signal)
        values[:, [*first, *second]] = values[:, [*second, *first]]


def scale(log, pattern, factor, signals):
    for signal in signals:
        getattr(log, signal)[:, log.at(pattern)] *= factor


def lowpass(values, share):
    kept = values.copy()
    for row in range(1, len(kept)):
        kept[row] = kept[row - 1] + share * (values[row] - kept[row - 1])
    return kept


RANDOM = np.random.default_rng(7)
ALL = ("q", "dq", "target")


@mutation()
def unchanged(log): pass
# Order.
@mutation()
def legs_swapped(log): swap(log, log.at("FL_*"), log.at("FR_*"), ALL)
@mutation()
def legs_swapped_in_the_state(log): swap(log, log.at("FL_*"), log.at("FR_*"), ("q", "dq"))
@mutation()
def legs_swapped_in_the_targets(log): swap(log, log.at("FL_*"), log.at("RL_*"), ("target",))
@mutation()
def velocities_of_swapped_legs(log): swap(log, log.at("FL_*"), log.at("FR_*"), ("dq",))
@mutation()
def thigh_and_calf_swapped(log): swap(log, log.at("FL_thigh"), log.at("FL_calf"), ALL)
@mutation()
def a_joint_copied_over_another(log):
    for signal in ALL:
        getattr(log, signal)[:, log.at("RR_thigh")] = getattr(log, signal)[:, log.at("RL_thigh")]
# Sign.
@mutation()
def sign_of_a_hip(log): scale(log, "FR_hip", -1, ALL)
@mutation()
def sign_of_a_hips_state(log): scale(log, "FR_hip", -1, ("q", "dq"))
@mutation()
def sign_of_a_velocity(log): scale(log, "RL_calf", -1, ("dq",))
@mutation()
def sign_of_all_velocities(log): scale(log, "*", -1, ("dq",))
@mutation()
def sign_of_a_target(log): scale(log, "RR_thigh", -1, ("target",))
@mutation()
def sign_of_everything(log): scale(log, "*", -1, ALL)
# Unit and scale.
@mutation()
def degrees(log): scale(log, "*", 57.29578, ALL)
@mutation()
def velocities_in_degrees(log): scale(log, "*", 57.29578, ("dq",))
@mutation()
def targets_in_degrees(log): scale(log, "*", 57.29578, ("target",))
@mutation()
def calves_before_the_gear(log): scale(log, "*_calf", 1.9169, ("q", "dq"))
@mutation()
def velocities_halved(log): scale(log, "*", 0.5, ("dq",))
@mutation()
def velocities_4_percent_large(log): scale(log, "*", 1.04, ("dq",))
@mutation()
def a_velocity_10_percent_large(log): scale(log, "RL_thigh", 1.1, ("dq",))
@mutation()
def targets_as_offsets(log): log.target -= log.target.mean(0)
@mutation()
def target_scaled_by_the_action_scale(log): scale(log, "*", 4.0, ("target",))
# Time.
@mutation("csv", "npz")
def milliseconds(log): log.time = log.time * 1000
@mutation()
def clock_at_half_speed(log): log.time = log.time * 2
@mutation()
def clock_4_percent_fast(log):
    log.time = log.time * 1.04
    log.rate = None
@mutation("csv", "npz")
def unix_time(log): log.time = log.time + 1.7e9
@mutation("csv", "npz")
def time_of_float32(log): log.time = np.float32(log.time + 40000).astype(float)
@mutation()
def time_in_ticks_of_10_ms(log): log.time = np.round(log.time, 2)
@mutation()
def time_in_ticks_of_50_ms(log): log.time = np.floor(log.time / 0.05) * 0.05
@mutation()
def jitter_of_stamps(log): log.time = log.time + RANDOM.uniform(-0.002, 0.002, len(log.time))
@mutation()
def lost_rows(log): log.rows(np.setdiff1d(np.arange(len(log.time)), RANDOM.choice(np.arange(5, len(log.time) - 5), 12, False)))
@mutation()
def gap(log): log.rows(np.r_[0:300, 400 : len(log.time)])
@mutation()
def every_fourth_row(log):
    log.rows(np.arange(0, len(log.time), 4))
    log.rate = None
@mutation("csv", "npz")
def reversed_rows(log):
    log.q, log.dq, log.target = log.q[::-1], log.dq[::-1], log.target[::-1]
@mutation("csv", "npz")
def rows_that_repeat(log): log.rows(np.repeat(np.arange(len(log.time)), np.where(np.arange(len(log.time)) % 50 == 0, 2, 1)))
@mutation()
def every_row_repeated_at_400_hz(log):
    log.rows(np.repeat(np.arange(len(log.time)), 2))
    log.time = np.arange(len(log.time)) / 400
    log.rate = None
@mutation("csv", "npz")
def time_counts_rows(log): log.time = np.arange(len(log.time), dtype=float)
@mutation("csv", "npz")
def one_wild_stamp(log):
    log.time = log.time.copy()
    log.time[400] += 10
@mutation("csv", "npz")
def a_second_start(log):
    log.time = log.time.copy()
    log.time[500:] -= log.time[500]
# Targets.
@mutation()
def targets_are_positions(log): log.target = log.q.copy()
@mutation()
def targets_a_row_late(log):
    log.target = np.roll(log.target, 1, 0)
    log.rows(np.arange(1, len(log.time)))
    log.truth["delay"] -= 0.005
@mutation()
def targets_a_row_early(log):
    log.target = np.roll(log.target, -1, 0)
    log.rows(np.arange(len(log.time) - 1))
    log.truth["delay"] += 0.005
@mutation()
def targets_of_zero(log): log.target = np.zeros_like(log.target)
@mutation()
def targets_frozen_halfway(log): log.target[400:] = log.target[400]
@mutation()
def targets_filtered(log): log.target = lowpass(log.target, 0.3)
@mutation()
def targets_quantised(log): log.target = np.round(log.target / 0.02) * 0.02
@mutation()
def targets_off_by_a_tenth(log): log.target = log.target + 0.1
@mutation()
def targets_at_50_hz(log): log.target = np.repeat(log.target[::4], 4, 0)[: len(log.time)]
# Sensors.
@mutation()
def positions_in_steps_of_20_mrad(log): log.q = np.round(log.q / 0.02) * 0.02
@mutation()
def zero_of_an_encoder(log): log.q[:, log.at("FL_calf")] += 0.1
@mutation()
def zeros_of_all_encoders(log): log.q = log.q + RANDOM.uniform(-0.04, 0.04, log.q.shape[1])
@mutation()
def velocities_filtered(log): log.dq = lowpass(log.dq, 0.3)
@mutation()
def velocities_filtered_lightly(log): log.dq = lowpass(log.dq, 0.7)
@mutation()
def velocities_from_differences(log): log.dq[1:] = np.diff(log.q, axis=0) / np.diff(log.time)[:, None]
@mutation()
def velocities_with_an_offset(log): log.dq = log.dq + 0.2
@mutation()
def velocities_cut_off(log): log.dq = np.clip(log.dq, -2, 2)
@mutation()
def velocities_of_zero(log): log.dq = np.zeros_like(log.dq)
@mutation()
def positions_filtered(log): log.q = lowpass(log.q, 0.4)
@mutation()
def state_filtered(log):
    log.q, log.dq = lowpass(log.q, 0.4), lowpass(log.dq, 0.4)
    # Sensors that are late are a longer delay.
    log.truth["delay"] += 0.005 * 0.6 / 0.4
@mutation()
def noise_of_10_mrad(log): log.q = log.q + RANDOM.normal(0, 0.01, log.q.shape)
@mutation()
def spikes(log): log.q[RANDOM.choice(len(log.q), 20, False), 4] += 0.5
@mutation("csv", "npz")
def zeros_between(log): log.q[::4], log.dq[::4] = 0, 0
@mutation()
def a_joint_that_froze(log):
    log.q[300:600, 0], log.dq[300:600, 0] = log.q[300, 0], 0
@mutation("csv", "npz")
def a_number_that_is_missing(log): log.q[500, 5] = np.nan
# Gains.
@mutation()
def gains_doubled(log): log.kp = [2 * gain for gain in log.kp]
@mutation()
def both_gains_doubled(log): log.kp, log.kd = [2 * gain for gain in log.kp], [2 * gain for gain in log.kd]
@mutation()
def gains_of_other_joints(log): log.kp, log.kd = log.kp[::-1], log.kd[::-1]
@mutation()
def damping_gain_of_zero(log): log.kd = [0.0, 0.0, 0.0]
@mutation()
def kp_and_kd_swapped(log): log.kp, log.kd = log.kd, log.kp
@mutation()
def gains_10_percent_large(log): log.kp = [1.1 * gain for gain in log.kp]
@mutation()
def no_gains(log): log.gains = False
# Files.
@mutation("csv")
def columns_shuffled(log): log.columns = RANDOM.permutation(3 * len(log.joints))
@mutation("csv")
def a_blank_cell_in_every_second_row(log): log.blank = True
@mutation("npz")
def time_array_of_float32(log):
    log.float32_time = True
    log.time = log.time + 86400
@mutation("npz")
def arrays_without_joint_names(log): log.names = False
@mutation("npz")
def arrays_in_another_order_without_names(log):
    log.names = False
    order = [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    log.q, log.dq, log.target = log.q[:, order], log.dq[:, order], log.target[:, order]
@mutation("npz", "mcap")
def no_velocities(log): log.no_velocity = True
@mutation("mcap")
def targets_stamped_later(log):
    log.lead = 0.0013
    log.truth["delay"] -= log.lead
@mutation("mcap")
def targets_stamped_with_jitter(log):
    log.lead, log.lead_jitter = 0.001, 0.0008
    log.truth["delay"] -= log.lead
@mutation("mcap")
def messages_without_stamps(log): log.stamped = False
@mutation("mcap")
def a_publisher_of_zeros(log): log.zeros_topic = True
@mutation("mcap")
def joints_of_messages_in_another_order(log):
    order = RANDOM.permutation(len(log.joints))
    log.joints = [log.joints[k] for k in order]
    log.q, log.dq, log.target = log.q[:, order], log.dq[:, order], log.target[:, order]


def write_csv(log, path):
    names = [f"{signal}_{joint}" for signal in ("q", "dq", "qdes") for joint in log.joints]
    table = np.column_stack([log.q, log.dq, log.target])
    if log.columns is not None:
        names, table = [names[k] for k in log.columns], table[:, log.columns]
    head = [] if log.rate is None else [f"# rate_hz = {log.rate}"]
    lines = [*head, ",".join(["time", *names])]
    for number, (time, row) in enumerate(zip(log.time, table, strict=True)):
        cells = [f"{time:.6f}", *(f"{value:.6f}" if np.isfinite(value) else "nan" for value in row)]
        if log.blank and number % 2:
            cells[5] = ""
        lines.append(",".join(cells))
    path.write_text("\n".join(lines) + "\n")


def write_npz(log, path):
    arrays = {"time": log.time.astype(np.float32) if log.float32_time else log.time, "joint_pos": log.q,
              "joint_vel": log.dq, "joint_pos_target": log.target}
    if log.names:
        arrays["joint_names"] = np.array(log.joints)
    if log.no_velocity:
        del arrays["joint_vel"]
    np.savez(path, **arrays)


def cdr(seconds, names, *arrays):
    """A JointState in little-endian CDR."""
    body = bytearray()

    def put(form, *values):
        size = struct.calcsize("<" + form[-1])
        body.extend(b"\0" * (-len(body) % size))
        body.extend(struct.pack("<" + form, *values))

    def text(words):
        put("I", len(words) + 1)
        body.extend(words.encode() + b"\0")

    nanoseconds = round(seconds * 1e9)
    put("i", nanoseconds // 10**9)
    put("I", nanoseconds % 10**9)
    text("")
    put("I", len(names))
    for name in names:
        text(name)
    for values in arrays:
        put("I", len(values))
        if len(values):
            put(f"{len(values)}d", *values)
    return b"\0\1\0\0" + bytes(body)


def write_mcap(log, path):
    """Messages of /joint_states and /joint_commands without chunks (mcap.dev/spec)."""
    start = 1000.0 if log.stamped else 0.0
    text = lambda words: struct.pack("<I", len(words)) + words.encode()
    record = lambda code, content: struct.pack("<BQ", code, len(content)) + content
    parts = [b"\x89MCAP0\r\n", record(1, text("ros2") + text("mutate_logs"))]
    schema = struct.pack("<H", 1) + text("sensor_msgs/msg/JointState") + text("ros2msg")
    parts.append(record(3, schema + text(JOINT_STATE)))
    for number, topic in ((1, "/joint_states"), (2, "/joint_commands")):
        parts.append(record(4, struct.pack("<HH", number, 1) + text(topic) + text("cdr") + struct.pack("<I", 0)))
    names = [f"{joint}_joint" for joint in log.joints]
    messages = []
    leads = log.lead + log.lead_jitter * RANDOM.uniform(-1, 1, len(log.time))
    for row, time in enumerate(log.time):
        velocity = () if log.no_velocity else log.dq[row]
        messages.append((time, 1, log.q[row], velocity))
        messages.append((time + leads[row], 2, log.target[row], ()))
        if log.zeros_topic and row % 4 == 0:
            messages.append((time + 0.002, 1, np.zeros(len(names)), np.zeros(len(names))))
    for count, (time, channel, position, velocity) in enumerate(sorted(messages, key=lambda one: one[0])):
        stamp = round((1000.0 + time) * 1e9)
        content = cdr(start + time if log.stamped else 0.0, names, position, velocity, ())
        parts.append(record(5, struct.pack("<HIQQ", channel, count, stamp, stamp) + content))
    parts.append(record(15, struct.pack("<I", 0)))
    parts.append(record(2, struct.pack("<QQI", 0, 0, 0)))
    path.write_bytes(b"".join(parts) + b"\x89MCAP0\r\n")


def call(*words):
    done = subprocess.run([str(word) for word in words], cwd=ROOT, capture_output=True, text=True, timeout=300)
    return done.returncode, done.stdout, done.stderr


def last(text):
    lines = [line for line in text.strip().splitlines() if line.startswith("error")] or text.strip().splitlines()
    return lines[0] if lines else ""


def judge(args, name, form, log):
    """What gaitfit makes of a log: verdict, exit code and first line, and the truths that its intervals leave out."""
    place = args.out / f"{name}-{form}"
    place.mkdir(parents=True, exist_ok=True)
    path = place / f"recording.{form}"
    {"csv": write_csv, "npz": write_npz, "mcap": write_mcap}[form](log, path)
    note = ""
    if form != "csv":
        converted = place / "log.csv"
        converted.unlink(missing_ok=True)
        code, output, errors = call(args.gaitfit, "import", path, "--out", converted, "--robot", "assets/go2.xml")
        if code:
            return "refused", f"import {code}", last(f"{output}\n{errors}"), []
        note = " ".join(line.strip() for line in output.splitlines() if line.startswith(("note", "warning")))
        path = converted
    configuration = place / "fit.toml"
    text = CONFIGURATION.format(
        name="fit", runs=place / "runs", robot="assets/go2.xml", log=path, kp=log.kp, kd=log.kd, search=args.search,
        generations=args.generations)
    if not log.gains:
        text = "\n".join(line for line in text.splitlines() if not line.startswith(("[gains", "kp =", "kd =")))
    configuration.write_text(text)
    code, output, errors = call(args.gaitfit, "fit", configuration, "--json", "--threads", "1")
    if code and not output.startswith("{"):
        return "refused", f"fit {code}", last(errors), []
    found = json.loads(output)
    missed = []
    for parameter in found["parameters"]:
        truth, interval = log.truth.get(parameter["name"]), parameter.get("interval")
        if truth is not None and not (interval and interval[0] - 1e-9 <= truth <= interval[1] + 1e-9):
            missed.append(f"{parameter['name']} {parameter['value']:.4g} {interval} for {truth:.4g}")
    verdict = "refused" if code else "WRONG" if missed else {"sound": "right"}.get(found["standing"], found["standing"])
    return verdict, f"fit {code}", found["headline"] if code or found["doubts"] else note, missed


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--gaitfit", type=pathlib.Path, default=ROOT / "target/debug/gaitfit", help="the program")
    parser.add_argument("--formats", default="csv,npz,mcap", help="[csv,npz,mcap]")
    parser.add_argument("--only", default="*", help="mutations by pattern [*]")
    parser.add_argument("--seconds", type=float, default=4.0, help="length of the log [4]")
    parser.add_argument("--jobs", type=int, default=1, help="fits at the same time [1]")
    parser.add_argument("--search", default="least-squares", choices=["least-squares", "cma-es"], help="[least-squares]")
    parser.add_argument("--generations", type=int, default=60, help="[60]")
    parser.add_argument("--out", type=pathlib.Path, help="keep files here [a temporary folder]")
    args = parser.parse_args()
    kept = tempfile.TemporaryDirectory() if args.out is None else None
    args.out = pathlib.Path(kept.name if kept else args.out).resolve()
    args.gaitfit = args.gaitfit.resolve()
    good = Log(args.seconds)
    work = []
    for name, (change, formats) in MUTATIONS.items():
        for form in (form for form in args.formats.split(",") if form in formats and fnmatch.fnmatch(name, args.only)):
            log = copy.deepcopy(good)
            change(log)
            work.append((name, form, log))
    counts = {}
    print(f"{'mutation':40} {'file':5} {'verdict':13} {'code':9} outside  first line")
    with concurrent.futures.ThreadPoolExecutor(args.jobs) as pool:
        for (name, form, _), found in zip(work, pool.map(lambda one: judge(args, *one), work), strict=True):
            verdict, code, line, missed = found
            counts[verdict] = counts.get(verdict, 0) + 1
            line = line.replace(str(args.out) + "/", "")
            print(f"{name:40} {form:5} {verdict:13} {code:9} {len(missed):7}  {line[:150]}", flush=True)
            if verdict == "WRONG":
                print("".join(f"    {miss}\n" for miss in missed), end="", flush=True)
    print(", ".join(f"{count} {verdict}" for verdict, count in sorted(counts.items())), f"of {len(work)}")
    sys.exit("WRONG" in counts)


if __name__ == "__main__":
    main()
