//! Messages against bytes of the vendor's Python SDK; `tools/make_robot_fixtures.py` made them.

use std::path::Path;
use std::process::Command;

use cdr_encoding::{from_bytes, to_vec};
use gaitfit_robot::unitree::{CMD_BYTES, LowCmd, LowState, STATE_BYTES, hg};

const CMD_WIRE: &[u8] = include_bytes!("../fixtures/lowcmd.cdr");
const CMD_STRUCT: &[u8] = include_bytes!("../fixtures/lowcmd.c");
const STATE_WIRE: &[u8] = include_bytes!("../fixtures/lowstate.cdr");
const STATE_STRUCT: &[u8] = include_bytes!("../fixtures/lowstate.c");

const HG_CMD_WIRE: &[u8] = include_bytes!("../fixtures/hg_lowcmd.cdr");
const HG_CMD_STRUCT: &[u8] = include_bytes!("../fixtures/hg_lowcmd.c");
const HG_STATE_WIRE: &[u8] = include_bytes!("../fixtures/hg_lowstate.cdr");
const HG_STATE_STRUCT: &[u8] = include_bytes!("../fixtures/hg_lowstate.c");

type Little = byteorder::LittleEndian;

#[test]
fn a_command_is_the_sdks_bit_for_bit() {
    let (command, used) = from_bytes::<LowCmd, Little>(CMD_WIRE).unwrap();
    assert_eq!(used, CMD_WIRE.len());
    assert_eq!(to_vec::<_, Little>(&command).unwrap(), CMD_WIRE);
    assert_eq!((command.layout().as_slice(), CMD_STRUCT.len()), (CMD_STRUCT, CMD_BYTES));
    assert_eq!(command.checksum(), command.crc);
    // Fields are where their names say: each has its own number, counted in the order of the IDL.
    assert_eq!((command.head, command.level_flag, command.frame_reserve), ([1, 2], 3, 4));
    let value = |count: i32| (-1.7 + 0.123 * f64::from(count)) as f32;
    let first = command.motor_cmd[0];
    assert_eq!([first.q, first.dq, first.tau, first.kp, first.kd], [11, 12, 13, 14, 15].map(value));
    assert_eq!(command.motor_cmd[19].q, value(11 + 19 * 9));
}

#[test]
fn a_state_is_the_sdks_bit_for_bit() {
    let (state, used) = from_bytes::<LowState, Little>(STATE_WIRE).unwrap();
    assert_eq!(used, STATE_WIRE.len());
    assert_eq!(to_vec::<_, Little>(&state).unwrap(), STATE_WIRE);
    assert_eq!((state.layout().as_slice(), STATE_STRUCT.len()), (STATE_STRUCT, STATE_BYTES));
    assert_eq!(state.checksum(), state.crc);
    let value = |count: i32| (-1.7 + 0.123 * f64::from(count)) as f32;
    assert_eq!(state.imu_state.quaternion, [10, 11, 12, 13].map(value));
    assert_eq!(state.imu_state.gyroscope, [14, 15, 16].map(value));
    let first = state.motor_state[0];
    assert_eq!([first.q, first.dq, first.ddq, first.tau_est], [25, 26, 27, 28].map(value));
}

#[test]
fn a_humanoids_command_is_the_sdks_bit_for_bit() {
    let (command, used) = from_bytes::<hg::LowCmd, Little>(HG_CMD_WIRE).unwrap();
    assert_eq!(used, HG_CMD_WIRE.len());
    assert_eq!(to_vec::<_, Little>(&command).unwrap(), HG_CMD_WIRE);
    assert_eq!((command.layout().as_slice(), HG_CMD_STRUCT.len()), (HG_CMD_STRUCT, hg::CMD_BYTES));
    assert_eq!(command.checksum(), command.crc);
    assert_eq!((command.mode_pr, command.mode_machine), (1, 2));
    let value = |count: i32| (-1.7 + 0.123 * f64::from(count)) as f32;
    let motors = command.motor_cmd.as_flattened();
    let [first, last] = [motors[0], motors[34]];
    assert_eq!([first.q, first.dq, first.tau, first.kp, first.kd], [4, 5, 6, 7, 8].map(value));
    assert_eq!(last.q, value(4 + 34 * 7));
}

#[test]
fn a_humanoids_state_is_the_sdks_bit_for_bit() {
    let (state, used) = from_bytes::<hg::LowState, Little>(HG_STATE_WIRE).unwrap();
    assert_eq!(used, HG_STATE_WIRE.len());
    assert_eq!(to_vec::<_, Little>(&state).unwrap(), HG_STATE_WIRE);
    assert_eq!((state.layout().as_slice(), HG_STATE_STRUCT.len()), (HG_STATE_STRUCT, hg::STATE_BYTES));
    assert_eq!(state.checksum(), state.crc);
    assert_eq!((state.mode_pr, state.mode_machine), (3, 4));
    let value = |count: i32| (-1.7 + 0.123 * f64::from(count)) as f32;
    assert_eq!(state.imu_state.quaternion, [6, 7, 8, 9].map(value));
    assert_eq!(state.imu_state.gyroscope, [10, 11, 12].map(value));
    let first = state.motor_state[0][0];
    assert_eq!([first.q, first.dq, first.ddq, first.tau_est], [21, 22, 23, 24].map(value));
    for length in 0..HG_STATE_WIRE.len() {
        assert!(from_bytes::<hg::LowState, Little>(&HG_STATE_WIRE[..length]).is_err(), "{length}");
    }
}

#[test]
fn damaged_bytes_are_refused_or_read_and_never_a_panic() {
    for length in 0..STATE_WIRE.len() {
        assert!(from_bytes::<LowState, Little>(&STATE_WIRE[..length]).is_err(), "{length}");
    }
    for place in 0..STATE_WIRE.len() {
        let mut bytes = STATE_WIRE.to_vec();
        bytes[place] ^= 0x55;
        let (state, _) = from_bytes::<LowState, Little>(&bytes).unwrap();
        // Padding between fields is not summed up.
        let padding = to_vec::<_, Little>(&state).unwrap() != bytes;
        assert_eq!(state.checksum() == state.crc, padding, "{place}");
    }
}

#[test]
#[ignore = "needs ../shared with the vendor's Python SDK, and cyclonedds in .venv"]
fn shared_the_fixtures_are_what_the_sdk_writes() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let Some(python) = crate::messages::sdk_python(&root) else { return };
    let run =
        Command::new(python).arg(root.join("tools/make_robot_fixtures.py")).arg("--check").output().unwrap();
    assert!(run.status.success(), "{}", String::from_utf8_lossy(&run.stderr));
}

/// A Python with the packages that the vendor's SDK needs, where the SDK is there too; see [`python_with`].
pub fn sdk_python(root: &Path) -> Option<std::path::PathBuf> {
    let sdk = root.join("../shared/third_party/unitree_sdk2_python");
    if !sdk.is_dir() {
        eprintln!("left out: {} is not there", sdk.display());
        return None;
    }
    python_with(root, "cyclonedds, numpy, mujoco")
}

/// A Python that has these modules: `GAITFIT_DDS_PYTHON`, or that of `.venv`. Without them `None`, and a line says so.
pub fn python_with(root: &Path, modules: &str) -> Option<std::path::PathBuf> {
    let given = std::env::var_os("GAITFIT_DDS_PYTHON");
    let python = given.map_or_else(|| root.join(".venv/bin/python"), Into::into);
    let able = Command::new(&python).args(["-c", &format!("import {modules}")]).output();
    if able.is_ok_and(|run| run.status.success()) {
        return Some(python);
    }
    eprintln!("left out: {} lacks {modules} (tools/setup_venv.sh --dds)", python.display());
    None
}
