"""Writes the files that crates/gaitfit-import is tested with: one motion in every kind of file that is read.

The motion is that of 12 joints of a Go2 at 200 Hz, rounded to float32 so that all files can hold the same numbers.
`motion.csv` is the reference. The writers are those of the formats' own projects: mcap, rosbags, NumPy, PyTorch, pyarrow, h5py.

Usage: python tools/make_import_fixtures.py [--out FOLDER]      (packages: tools/requirements-import.txt)
"""

import argparse
import math
import pathlib
import pickle
import shutil

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.feather
import pyarrow.parquet
import torch
from mcap_ros2.writer import CompressionType, Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as BagWriter
from rosbags.typesys import Stores, get_typestore

FOLDER = pathlib.Path(__file__).resolve().parent.parent / "crates/gaitfit-import/tests/fixtures"
SAMPLES, RATE = 40, 200
START = 1_700_000_000_000_000_000  # ns since 1970
LEGS, PARTS = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
JOINTS = [f"{leg}_{part}" for leg in LEGS for part in PARTS]
MOTORS = [f"{leg}_{part}" for leg in ("FR", "FL", "RR", "RL") for part in PARTS]  # Unitree's order
KP, KD = 20.0, 0.5

LINE = "=" * 80
STAMP = f"{LINE}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n{LINE}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n"
JOINT_STATE = "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n" + STAMP
POINT = f"{LINE}\nMSG: trajectory_msgs/JointTrajectoryPoint\nfloat64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\nbuiltin_interfaces/Duration time_from_start\n{LINE}\nMSG: builtin_interfaces/Duration\nint32 sec\nuint32 nanosec\n"
CONTROLLER = "std_msgs/Header header\nstring[] joint_names\ntrajectory_msgs/JointTrajectoryPoint reference\ntrajectory_msgs/JointTrajectoryPoint feedback\n" + STAMP + POINT
IMU_STATE = "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\n"
GO_STATE = (
    "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\nuint16 bandwidth\n"
    "IMUState imu_state\nMotorState[20] motor_state\nuint32 tick\nuint8[40] wireless_remote\nuint32 crc\n"
    f"{LINE}\nMSG: unitree_go/IMUState\n{IMU_STATE}int8 temperature\n"
    f"{LINE}\nMSG: unitree_go/MotorState\nuint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n"
    "float32 q_raw\nfloat32 dq_raw\nfloat32 ddq_raw\nint8 temperature\nuint32 lost\nuint32[2] reserve\n"
)
GO_CMD = (
    "uint8[2] head\nMotorCmd[20] motor_cmd\nuint32 crc\n"
    f"{LINE}\nMSG: unitree_go/MotorCmd\nuint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\nuint32[3] reserve\n"
)
HG_STATE = (
    "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\nIMUState imu_state\nMotorState[35] motor_state\n"
    "uint8[40] wireless_remote\nuint32[4] reserve\nuint32 crc\n"
    f"{LINE}\nMSG: unitree_hg/IMUState\n{IMU_STATE}int16 temperature\n"
    f"{LINE}\nMSG: unitree_hg/MotorState\nuint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\n"
    "int16[2] temperature\nfloat32 vol\nuint32[2] sensor\nuint32 motorstate\nuint32[4] reserve\n"
)


def motion():
    """Times (n), positions, velocities, targets (n, 12), all float32 as float64."""
    time = np.arange(SAMPLES) / RATE
    phase = np.linspace(0, 4, 12)
    rest = np.tile([0.0, 0.8, -1.5], 4)
    wave = 2 * np.pi * 2.0
    q = rest + 0.3 * np.sin(wave * time[:, None] + phase)
    dq = 0.3 * wave * np.cos(wave * time[:, None] + phase)
    target = rest + 0.35 * np.sin(wave * (time[:, None] + 0.02) + phase)
    return [time, *(x.astype(np.float32).astype(np.float64) for x in (q, dq, target))]


def header(ns):
    return {"stamp": {"sec": int(ns // 10**9), "nanosec": int(ns % 10**9)}, "frame_id": ""}


def ns_of(time):
    return START + int(round(time * 1e9))


def joint_state(ns, position, velocity=(), names=JOINTS):
    return {"header": header(ns), "name": list(names), "position": list(position), "velocity": list(velocity), "effort": []}


def write_csv(out, time, q, dq, target):
    names = ["time", *(f"{p}_{j}" for p in ("q", "dq", "qdes") for j in JOINTS)]
    lines = [f"# rate_hz = {RATE}", f"# kp = {KP}", f"# kd = {KD}", ",".join(names)]
    for row in np.column_stack([time, q, dq, target]):
        lines.append(",".join(repr(float(x)) for x in row))
    (out / "motion.csv").write_text("\n".join(lines) + "\n")


def write_mcap(out, time, q, dq, target):
    """JointState of state and command, chunks by Zstandard; a topic of another kind among them."""
    with open(out / "joint_states.mcap", "wb") as file:
        writer = Writer(file, chunk_size=8192, compression=CompressionType.ZSTD)
        kind = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        text = writer.register_msgdef("std_msgs/msg/String", "string data\n")
        for i, t in enumerate(time):
            ns = ns_of(t)
            names = [f"{j}_joint" for j in JOINTS]
            writer.write_message("/joint_states", kind, joint_state(ns, q[i], dq[i], names), ns + 400_000, ns)
            # Commands name their joints in another order.
            writer.write_message("/joint_commands", kind, joint_state(ns, target[i][::-1], (), JOINTS[::-1]), ns + 450_000, ns)
            if i % 10 == 0:
                writer.write_message("/rosout", text, {"data": "walking"}, ns, ns)
        writer.finish()


def write_unitree(out, time, q, dq, target):
    """LowState and LowCmd of a Go2 without stamps, chunks by LZ4."""
    order = [JOINTS.index(motor) for motor in MOTORS]
    idle = {"mode": 0, "q": 0.0, "dq": 0.0, "ddq": 0.0, "tau_est": 0.0, "q_raw": 0.0, "dq_raw": 0.0, "ddq_raw": 0.0,
            "temperature": 0, "lost": 0, "reserve": [0, 0]}
    command = {"mode": 0, "q": 0.0, "dq": 0.0, "tau": 0.0, "kp": 0.0, "kd": 0.0, "reserve": [0, 0, 0]}
    imu = {"quaternion": [1.0, 0.0, 0.0, 0.0], "gyroscope": [0.125, -0.25, 0.5], "accelerometer": [0.0, 0.0, 9.81],
           "rpy": [0.0, 0.0, 0.0], "temperature": 30}
    with open(out / "unitree_go.mcap", "wb") as file:
        writer = Writer(file, chunk_size=16384, compression=CompressionType.LZ4)
        state = writer.register_msgdef("unitree_go/msg/LowState", GO_STATE)
        cmd = writer.register_msgdef("unitree_go/msg/LowCmd", GO_CMD)
        for i, t in enumerate(time):
            ns = ns_of(t)
            motors = [idle | {"mode": 1, "q": q[i][j], "dq": dq[i][j]} for j in order] + [idle] * 8
            commands = [command | {"mode": 1, "q": target[i][j], "kp": KP, "kd": KD} for j in order] + [command] * 8
            writer.write_message("/lowstate", state, {
                "head": [254, 239], "level_flag": 255, "frame_reserve": 0, "sn": [0, 0], "version": [0, 0], "bandwidth": 0,
                "imu_state": imu, "motor_state": motors, "tick": i, "wireless_remote": [0] * 40, "crc": 7}, ns, ns)
            writer.write_message("/lowcmd", cmd, {"head": [254, 239], "motor_cmd": commands, "crc": 7}, ns, ns)
        writer.finish()


def write_unitree_hg(out):
    """LowState of a G1: motor i is at 0.01 · i + 0.5 · t."""
    idle = {"mode": 0, "q": 0.0, "dq": 0.0, "ddq": 0.0, "tau_est": 0.0, "temperature": [30, 31], "vol": 48.0,
            "sensor": [0, 0], "motorstate": 0, "reserve": [0] * 4}
    imu = {"quaternion": [1.0, 0.0, 0.0, 0.0], "gyroscope": [0.0] * 3, "accelerometer": [0.0] * 3, "rpy": [0.0] * 3,
           "temperature": 30}
    with open(out / "unitree_hg.mcap", "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        state = writer.register_msgdef("unitree_hg/msg/LowState", HG_STATE)
        for i in range(6):
            motors = [idle | {"q": 0.01 * m + 0.5 * i / 500, "dq": 0.5} for m in range(29)] + [idle] * 6
            writer.write_message("/lowstate", state, {
                "version": [0, 0], "mode_pr": 0, "mode_machine": 5, "tick": i, "imu_state": imu, "motor_state": motors,
                "wireless_remote": [0] * 40, "reserve": [0] * 4, "crc": 0}, START + 2_000_000 * i)
        writer.finish()


def write_controller(out, time, q, dq, target):
    """control_msgs/JointTrajectoryControllerState: targets and state in one message."""
    point = lambda p, v: {"positions": list(p), "velocities": list(v), "accelerations": [], "effort": [],
                          "time_from_start": {"sec": 0, "nanosec": 0}}
    with open(out / "controller.mcap", "wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        kind = writer.register_msgdef("control_msgs/msg/JointTrajectoryControllerState", CONTROLLER)
        for i, t in enumerate(time):
            ns = ns_of(t)
            writer.write_message("/controller_state", kind, {
                "header": header(ns), "joint_names": JOINTS, "reference": point(target[i], []),
                "feedback": point(q[i], dq[i])}, ns, ns)
        writer.finish()


def write_bag(out, time, q, dq, target):
    """A ROS 2 bag of the kind db3, as rosbag2 writes it."""
    folder = out / "bag"
    shutil.rmtree(folder, ignore_errors=True)
    store = get_typestore(Stores.ROS2_HUMBLE)
    kind = "sensor_msgs/msg/JointState"
    JointState, Header, Time = (store.types[k] for k in (kind, "std_msgs/msg/Header", "builtin_interfaces/msg/Time"))
    with BagWriter(folder, version=8, storage_plugin=StoragePlugin.SQLITE3) as bag:
        state = bag.add_connection("/joint_states", kind, typestore=store)
        command = bag.add_connection("/joint_commands", kind, typestore=store)
        for i, t in enumerate(time):
            ns = ns_of(t)
            head = Header(stamp=Time(sec=ns // 10**9, nanosec=ns % 10**9), frame_id="")
            none = np.zeros(0)
            message = JointState(header=head, name=JOINTS, position=q[i], velocity=dq[i], effort=none)
            bag.write(state, ns, store.serialize_cdr(message, kind))
            message = JointState(header=head, name=JOINTS, position=target[i], velocity=none, effort=none)
            bag.write(command, ns, store.serialize_cdr(message, kind))


def write_arrays(out, time, q, dq, target):
    single = lambda x: x.astype(np.float32)
    np.savez_compressed(out / "motion.npz", time=time, joint_pos=q, joint_vel=np.asfortranarray(dq), joint_pos_target=single(target),
                        joint_names=np.array(JOINTS), kp=np.float64(KP), kd=np.float64(KD))
    # PACE: no velocities, no names.
    torch.save({"time": torch.from_numpy(time), "dof_pos": torch.from_numpy(single(q)),
                "des_dof_pos": torch.from_numpy(single(target))}, out / "pace.pt")
    # One storage, seen through strides.
    both = torch.from_numpy(np.concatenate([q, dq], axis=1))
    torch.save({"time": torch.from_numpy(time), "dof_pos": both[:, :12], "dof_vel": both[:, 12:],
                "des_dof_pos": torch.from_numpy(target)}, out / "motion.pt")
    with open(out / "motion.pkl", "wb") as file:
        pickle.dump({"time": list(time), "joint_pos": q, "joint_vel": [list(row) for row in dq],
                     "joint_pos_target": single(target), "joint_names": JOINTS}, file, protocol=5)


def write_columns(out, time, q, dq, target):
    """Parquet and Arrow: a column a joint, and a list in every row; all encodings, packings and kinds of pages."""
    table = {"time": time}
    for name, values in (("q", q), ("dq", dq), ("qdes", target)):
        table |= {f"{name}_{joint}": values[:, i] for i, joint in enumerate(JOINTS)}
    columns = pa.table(table)
    stamps = pa.array(START + np.round(time * 1e9).astype(np.int64), pa.timestamp("ns"))
    lists = lambda values, kind: pa.array(values.tolist(), pa.list_(kind))
    rows = pa.table({"stamp": stamps, "joint_pos": lists(q, pa.float64()), "joint_vel": lists(dq, pa.float64()),
                     "joint_pos_target": lists(target, pa.float32()), "mode": pa.array(["walk"] * len(time))})
    pa.parquet.write_table(columns, out / "motion.parquet", compression="snappy", row_group_size=16)
    pa.feather.write_feather(columns, out / "motion.arrow", compression="uncompressed")
    pa.parquet.write_table(rows, out / "lists.parquet", compression="zstd", data_page_version="2.0")
    pa.feather.write_feather(rows, out / "lists.arrow", compression="lz4", chunksize=16)
    # Numbers in hundredths, so that integers hold them: `kinds.csv` is the reference of `kinds.parquet`.
    whole = np.round(100 * q[:, :3]).astype(np.int64)
    kinds = {"time": pa.array(np.arange(SAMPLES) * 5000, pa.duration("us")), "q_a": pa.array(whole[:, 0]),
             "q_b": pa.array(whole[:, 1], pa.int32()), "q_c": pa.array(0.01 * whole[:, 2]),
             "dq_a": pa.array(np.round(dq[:, 0]).astype(np.int64)), "dq_b": pa.array(dq[:, 1].astype(np.float32)),
             "dq_c": pa.array(np.arange(SAMPLES) % 3 == 0)}
    kinds = pa.table(kinds)
    pa.parquet.write_table(kinds, out / "kinds.parquet", compression={"time": "zstd", "q_a": "lz4", "q_b": "snappy", "q_c": "zstd",
        "dq_a": "none", "dq_b": "gzip", "dq_c": "gzip"}, use_dictionary=["q_b"], column_encoding={
        "q_a": "DELTA_BINARY_PACKED", "q_c": "BYTE_STREAM_SPLIT", "dq_a": "PLAIN", "dq_b": "BYTE_STREAM_SPLIT",
        "dq_c": "RLE", "time": "DELTA_BINARY_PACKED"}, store_schema=False, data_page_version="2.0")
    columns = [whole[:, 0], whole[:, 1], 0.01 * whole[:, 2], np.round(dq[:, 0]), dq[:, 1].astype(np.float32), np.arange(SAMPLES) % 3 == 0]
    lines = ["time_us,q_a,q_b,q_c,dq_a,dq_b,dq_c"]
    lines += [",".join([str(5000 * i), *(repr(float(c[i])) for c in columns)]) for i in range(SAMPLES)]
    (out / "kinds.csv").write_text("\n".join(lines) + "\n")
    with pa.OSFile(str(out / "stream.arrow"), "wb") as file:
        options = pa.ipc.IpcWriteOptions(compression="zstd")
        with pa.ipc.new_stream(file, pa.table(table).schema, options=options) as writer:
            writer.write_table(pa.table(table), max_chunksize=16)


def write_hdf5(out, time, q, dq, target):
    """HDF5 as a plain log with packed chunks, and as Isaac Lab and robomimic record: a group for each of two episodes."""
    with h5py.File(out / "motion.h5", "w", track_order=False) as file:
        file["time"] = time
        file.create_dataset("joint_pos", data=q, chunks=(16, 12), compression="gzip", shuffle=True)
        file.create_dataset("joint_vel", data=dq, chunks=(16, 12), fletcher32=True)
        file["joint_pos_target"] = target.astype(np.float32)
        file["joint_names"] = np.array([joint.encode() for joint in JOINTS])
        file["kp"], file["kd"] = KP, KD
    with h5py.File(out / "episodes.h5", "w", libver="latest") as file:
        for number, scale in enumerate((1.0, 0.5)):
            group = file.create_group(f"data/demo_{number}")
            group["actions"] = scale * target
            group["obs/joint_pos"], group["obs/joint_vel"] = scale * q, scale * dq
            group["obs/picture"] = np.zeros((SAMPLES, 2, 2, 3), np.uint8)


def write_huge(out):
    """Small files of many numbers: 3e9 in HDF5 chunks that were never written, 6e6 in Parquet as runs of one number."""
    with h5py.File(out / "huge.h5", "w") as file:
        file.create_dataset("joint_pos", shape=(1 << 28, 12), chunks=(1 << 16, 12), compression="gzip", dtype="f8")
    column = pa.array(np.zeros(3_000_000))
    table = pa.table({"time": column, "q_a": column})
    pa.parquet.write_table(table, out / "huge.parquet", compression="zstd", write_statistics=False, row_group_size=3_000_000)


def write_old_pickle(out):
    """A pickle of protocol 0, which is text: 20 samples of two joints."""
    table = {"time": [0.01 * i for i in range(20)], "joint_pos": [[math.sin(0.1 * i), 0.2] for i in range(20)],
             "joint_names": ["a", "b"]}
    (out / "protocol_0.pkl").write_bytes(pickle.dumps(table, protocol=0))


def write_walk_these_ways(out, time, q, dq, target):
    """A deployment's log.pkl: an action is sent, then the state that follows it is read into the same row."""
    infos = []
    for i in range(-1, SAMPLES):
        state = max(i + 1, 0) if i + 1 < SAMPLES else SAMPLES - 1
        sent = max(i, 0)
        infos.append({
            "joint_pos": q[state][None], "joint_vel": dq[state][None], "joint_pos_target": target[sent][None],
            "joint_vel_target": np.zeros((1, 12)), "body_linear_vel": np.zeros((1, 3)), "body_angular_vel": np.zeros((1, 3)),
            "contact_state": np.ones((1, 4)), "clock_inputs": np.zeros((1, 4), np.float32),
            "body_linear_vel_cmd": np.array([[0.5, 0.25]]), "body_angular_vel_cmd": np.array([[-0.75, 0.0, 3.0]]),
            "privileged_obs": None, "camera_image_front": None, "reward": None, "done": None, "timestep": i + 1,
            "time": (i + 1) / RATE, "action": (4 * target[sent])[None].astype(np.float32), "rpy": np.zeros(3),
            "torques": np.zeros(12)})
    cfg = {"control": {"stiffness": {"joint": KP}, "damping": {"joint": KD}, "action_scale": 0.25}, "env": {"num_envs": 1}}
    with open(out / "walk_these_ways.pkl", "wb") as file:
        pickle.dump({"hardware_closed_loop": [cfg, infos]}, file, protocol=4)


def write_text(out, time, q, dq, target):
    """A CSV as one writes it oneself: degrees, decimal commas, milliseconds, another order of joints."""
    number = lambda x: repr(float(x)).replace(".", ",")
    order = [JOINTS.index(motor) for motor in MOTORS]
    names = ["Uhr [ms]", *(f"Winkel {i} Motor" for i in range(12)), *(f"w{i}" for i in range(12)), *(f"soll_{j}" for j in MOTORS), "note"]
    lines = [";".join(names)]
    for i, t in enumerate(time):
        degrees = np.degrees(np.concatenate([q[i][order], dq[i][order], target[i][order]]))
        lines.append(";".join([number(1e3 * t), *map(number, degrees), "ok"]))
    (out / "odd.csv").write_text("\n".join(lines) + "\n")
    listed = ", ".join(f'"{m}"' for m in MOTORS)
    speeds = ", ".join(f'"w{i}"' for i in range(12))
    (out / "odd.toml").write_text(
        f'joints = [{listed}]\nunit = "deg"\nkp = {KP}\nkd = {KD}\n\n[time]\ncolumn = "Uhr [ms]"\nunit = "ms"\n\n'
        f'[columns]\nposition = "Winkel {{index}} Motor"\nvelocity = [{speeds}]\ntarget = "soll_{{joint}}"\n')
    # PlotJuggler: one row for every time of any topic, empty cells where a topic has no sample.
    names = ["__time"]
    for topic, fields in (("/joint_states", ("position", "velocity")), ("/joint_commands", ("position",))):
        names += [f"{topic}/{joint}/{field}" for field in fields for joint in JOINTS]
    lines = [",".join(names)]
    rows = [(float(t) - 0.0005, [""] * 24 + [repr(float(x)) for x in target[i]]) for i, t in enumerate(time)]
    rows += [(float(t), [repr(float(x)) for x in (*q[i], *dq[i])] + [""] * 12) for i, t in enumerate(time)]
    lines += [",".join([repr(1.7e9 + t), *cells]) for t, cells in sorted(rows)]
    (out / "plotjuggler.csv").write_text("\n".join(lines) + "\n")


def write_two_rates(out):
    """State at 500 Hz and actions at 50 Hz whose sender's clock is 3 ms ahead; both received within half a millisecond.

    Joint a moves as t, joint b as 2 t. Action n is (n, -n), sent at 20 n ms."""
    random = np.random.default_rng(7)
    messages = []
    for i in range(150):
        t = i * 2_000_000
        messages.append((t + 300_000 + int(random.integers(200_000)), "/joint_states",
                         joint_state(START + t, [t / 1e9, 2 * t / 1e9], [1.0, 2.0], "ab")))
    for i in range(15):
        t = i * 20_000_000
        messages.append((t + 300_000 + int(random.integers(200_000)), "/joint_commands",
                         joint_state(START + t + 3_000_000, [float(i), -float(i)], [], "ab")))
    with open(out / "two_rates.mcap", "wb") as file:
        writer = Writer(file, compression=CompressionType.NONE)
        kind = writer.register_msgdef("sensor_msgs/msg/JointState", JOINT_STATE)
        for log, topic, message in sorted(messages, key=lambda entry: entry[0]):
            writer.write_message(topic, kind, message, START + log, START + log)
        writer.finish()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=pathlib.Path, default=FOLDER)
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    found = motion()
    for write in (write_csv, write_mcap, write_unitree, write_controller, write_bag, write_arrays, write_columns, write_hdf5, write_walk_these_ways, write_text):
        write(out, *found)
    write_unitree_hg(out)
    write_old_pickle(out)
    write_huge(out)
    write_two_rates(out)
    for path in sorted(out.rglob("*")):
        print(f"{path.relative_to(out)}: {path.stat().st_size} bytes" if path.is_file() else path.name)


if __name__ == "__main__":
    main()
