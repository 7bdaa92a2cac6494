//! From joint angles, and what is known of the base, to frames that a replay draws.

use gaitfit_model::Model;
use gaitfit_model::kinematics::{self, body_frames, lowest_point};
use gaitfit_model::rotation::{Quat, Vec3, heading, normalize, quat_of, sub, to_heading, vec_of};
use gaitfit_view::replay::Frame;

/// Geoms at most so high above the lowest one stand, m: they say how the base moves.
const STANDING_M: f64 = 0.01;
/// Time over which a velocity is averaged, s.
const AVERAGED_S: f64 = 0.3;
/// Clearance below the feet of a clamped robot, m.
const HANGING_M: f64 = 0.08;

/// A motion: rows of joint angles in the model's order, and the base's pose, a row a sample.
pub(super) struct Motion {
    /// Time between rows, s.
    pub dt: f64,
    /// Joint angles, rad; `rows × joints`.
    pub joints: Vec<f64>,
    /// Position of the base, m, in the world.
    pub position: Vec<Vec3>,
    /// Its orientation, wxyz.
    pub quaternion: Vec<Quat>,
}

impl Motion {
    /// A robot whose base is clamped: level, and so high that it touches no ground. `joints` as in the fields.
    pub fn clamped(model: &Model, dt: f64, joints: Vec<f64>) -> Self {
        let level = [1.0, 0.0, 0.0, 0.0];
        let rows = rows(model, &joints);
        let depth = |row| -lowest(model, level, angles(model, &joints, row)).0;
        // A part of the rows is enough for a height; the clearance covers the rest.
        let height = (0..rows).step_by(7).map(depth).fold(0.0, f64::max) + HANGING_M;
        Self { dt, joints, position: vec![[0.0, 0.0, height]; rows], quaternion: vec![level; rows] }
    }

    /// A robot that walks, of which joints and, if known, the attitude are measured: its lowest parts stand on the ground
    /// and do not slip, so that the base moves against them (leg odometry without forces).
    pub fn walked(model: &Model, dt: f64, joints: Vec<f64>, attitude: Option<&[f64]>) -> Self {
        let rows = rows(model, &joints);
        let level = [1.0, 0.0, 0.0, 0.0];
        let quaternion: Vec<Quat> = (0..rows)
            .map(|row| {
                attitude
                    .and_then(|all| all.get(4 * row..4 * row + 4))
                    .map_or(level, |q| normalize(quat_of(q)))
            })
            .collect();
        // From row to row the base moves against the mean step of the feet that stand in both: the step of a foot that
        // touches down is a part of its swing.
        let mut position: Vec<Vec3> = Vec::with_capacity(rows);
        // The places of the row before, and whether they stood.
        let mut last: Vec<(Vec3, bool)> = Vec::new();
        let mut at = [0.0, 0.0];
        for row in 0..rows {
            let (depth, places) = lowest(model, quaternion[row], angles(model, &joints, row));
            let stands = |place: Vec3| (place, place[2] < depth + STANDING_M);
            let places: Vec<(Vec3, bool)> = places.into_iter().map(stands).collect();
            let steps = |stood: bool| -> Vec<Vec3> {
                let pairs = places.iter().zip(&last).filter(|(now, before)| now.1 && (before.1 || !stood));
                pairs.map(|((now, _), (before, _))| sub(*before, *now)).collect()
            };
            // If no foot stands in both rows, those that stand now show best how the base moved.
            let steps = Some(steps(true)).filter(|both| !both.is_empty()).unwrap_or_else(|| steps(false));
            for (k, at) in at.iter_mut().enumerate() {
                *at += steps.iter().map(|step| step[k]).sum::<f64>() / steps.len().max(1) as f64;
            }
            position.push([at[0], at[1], -depth]);
            last = places;
        }
        Self { dt, joints, position, quaternion }
    }

    /// Frames of every `every`-th row from `from` on. `reference`: joint angles at which the model is drawn unturned.
    /// `commands`: `rows × 3`; a motion without them is shown without its velocity.
    pub fn frames(&self, model: &Model, from: usize, every: usize, commands: Option<&[f64]>) -> Vec<Frame> {
        let rows = self.position.len();
        let frame = |row: usize| {
            let angles = angles(model, &self.joints, row).iter().zip(&model.joints);
            let command = commands.and_then(|all| all.get(3 * row..3 * row + 3));
            Frame {
                base_position: self.position[row],
                base_quaternion: self.quaternion[row],
                joints: angles.map(|(angle, joint)| angle - joint.reference).collect(),
                contacts: Vec::new(),
                command: command.map_or([0.0; 3], vec_of),
                velocity: if command.is_some() { self.velocity(row) } else { [f64::NAN; 3] },
            }
        };
        (from..rows).step_by(every.max(1)).map(frame).collect()
    }

    /// Velocity about a row: forward and left, m/s, and yaw rate, rad/s, in the base's heading frame.
    fn velocity(&self, row: usize) -> Vec3 {
        // At least one row to each side: otherwise a slow log would have no difference.
        let reach = (0.5 * AVERAGED_S / self.dt).round().max(1.0) as usize;
        let (from, to) = (row.saturating_sub(reach), (row + reach).min(self.position.len() - 1));
        let seconds = self.dt * (to - from).max(1) as f64;
        let moved = sub(self.position[to], self.position[from]).map(|x| x / seconds);
        let along = to_heading(self.quaternion[row], moved);
        let turned = heading(self.quaternion[to]) - heading(self.quaternion[from]);
        // Across ±π a heading jumps by a whole turn.
        let turned = turned - std::f64::consts::TAU * (turned / std::f64::consts::TAU).round();
        [along[0], along[1], turned / seconds]
    }
}

fn rows(model: &Model, joints: &[f64]) -> usize {
    joints.len() / model.joints.len().max(1)
}

fn angles<'a>(model: &Model, joints: &'a [f64], row: usize) -> &'a [f64] {
    let width = model.joints.len();
    &joints[row * width..(row + 1) * width]
}

/// Height of the lowest point of all geoms against the base, m, and the places of the geoms' lowest points.
fn lowest(model: &Model, quaternion: Quat, q: &[f64]) -> (f64, Vec<Vec3>) {
    let frames = body_frames(model, &kinematics::Frame { position: [0.0; 3], quaternion }, q);
    // A model without pairs does not say which geoms touch the ground, so all may.
    let touching: Vec<usize> = match model.pairs.is_empty() {
        true => (0..model.geoms.len()).collect(),
        false => model.pairs.iter().map(|pair| pair.geom).collect(),
    };
    let place = |&geom: &usize| {
        let (geom, frame) = (&model.geoms[geom], &frames[model.geoms[geom].body]);
        let [x, y, _] = frame.point(geom.pos);
        [x, y, lowest_point(geom, frame)]
    };
    let mut places: Vec<Vec3> = touching.iter().map(place).collect();
    if places.is_empty() {
        places = frames.iter().map(|frame| frame.position).collect();
    }
    (places.iter().map(|place| place[2]).fold(f64::INFINITY, f64::min), places)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_learn::evaluate::{Subject, record_gait};
    use gaitfit_learn::task::{Task, TaskSettings};
    use gaitfit_physics::Preset;

    /// A Go2 whose legs swing back under it at a steady rate walks ahead as fast as its feet go back.
    #[test]
    fn legs_that_sweep_back_carry_the_base_ahead() {
        let model = crate::robot::go2().unwrap();
        let dt = 0.02;
        let row = |k: usize| -> Vec<f64> {
            let swing = 0.3 * dt * k as f64;
            model
                .joints
                .iter()
                .map(|joint| match &joint.name {
                    name if name.contains("thigh") => 0.8 + swing,
                    name if name.contains("calf") => -1.6,
                    _ => 0.0,
                })
                .collect()
        };
        let joints: Vec<f64> = (0..50).flat_map(row).collect();
        let motion = Motion::walked(&model, dt, joints.clone(), None);
        let end = motion.position[49];
        // The hip is about 0.3 m above the foot; 0.3 rad/s over 0.98 s moves it by some 0.09 m.
        assert!((0.05..0.13).contains(&end[0]), "{end:?}");
        assert!(end[1].abs() < 1e-3 && (0.2..0.4).contains(&end[2]), "{end:?}");
        let commands = [0.5, 0.0, 0.0].repeat(50);
        let frame = &motion.frames(&model, 0, 1, Some(&commands))[25];
        assert!((0.05..0.13).contains(&frame.velocity[0]), "{:?}", frame.velocity);
        let hanging = Motion::clamped(&model, dt, joints);
        let (depth, _) = lowest(&model, [1.0, 0.0, 0.0, 0.0], angles(&model, &hanging.joints, 0));
        assert!(hanging.position[0][2] + depth > 0.9 * HANGING_M, "the feet hang in the air");
        assert!(
            hanging.frames(&model, 0, 1, None)[0].velocity[0].is_nan(),
            "a clamped robot has no velocity"
        );
    }

    /// One foot is put down ahead while three stand: the base stays.
    #[test]
    fn a_foot_that_touches_down_does_not_move_the_base() {
        let model = crate::robot::go2().unwrap();
        let row = |calf: f64| -> Vec<f64> {
            let angle = |name: &str| match name {
                "FL_calf_joint" => calf,
                name if name.contains("calf") => -1.6,
                name if name.contains("thigh") => 0.8,
                _ => 0.0,
            };
            model.joints.iter().map(|joint| angle(&joint.name)).collect()
        };
        let joints = [row(-1.6), row(-2.0), row(-1.6)].concat();
        let motion = Motion::walked(&model, 0.02, joints, None);
        assert!(motion.position.iter().all(|[x, y, _]| x.hypot(*y) < 1e-9), "{:?}", motion.position);
    }

    /// A simulated walk: the base goes where the simulation's base went, to a fifth of the way.
    #[test]
    fn standing_feet_show_where_a_walk_leads() {
        let model = crate::robot::go2().unwrap();
        let file = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/go2-walk.safetensors");
        let policy = gaitfit_policy_files::read(&file).unwrap();
        let settings = TaskSettings::default().calm();
        let task =
            Task::with_interface(&model, &settings, policy.interface.clone(), Preset::Fast, 0.0).unwrap();
        let subject =
            Subject { task: &task, policy: &policy, candidate: None, seed: 5, cancel: None, moved: None };
        for command in [[0.6, 0.0, 0.0], [0.0, 0.4, 0.0], [-0.5, -0.4, 0.0]] {
            let record = record_gait(&subject, &[(5.0, command)]).unwrap();
            let rows = record.steps();
            let attitude: Vec<f64> =
                (0..rows).flat_map(|row| record.base[7 * row + 3..7 * row + 7].to_vec()).collect();
            let motion = Motion::walked(&model, record.dt, record.joint_position.clone(), Some(&attitude));
            let base = |row: usize, k: usize| record.base[7 * row + k];
            let missed = [0, 1].map(|k| motion.position[rows - 1][k] - (base(rows - 1, k) - base(0, k)));
            let way = (base(rows - 1, 0) - base(0, 0)).hypot(base(rows - 1, 1) - base(0, 1));
            assert!(missed[0].hypot(missed[1]) < way / 5.0, "{command:?}: {missed:?} of {way} m");
        }
    }
}
