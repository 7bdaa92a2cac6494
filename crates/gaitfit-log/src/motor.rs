//! Commands of a motor besides its position target: gains of each sample, desired velocities, feed-forward torques.
//!
//! A motor board in "MIT mode" makes the torque kp (q_des − q) + kd (dq_des − dq) + τ_ff. With constant gains that is the
//! torque of the position target q_des + (kd dq_des + τ_ff) / kp alone, which a log's target becomes.

use crate::Gains;
use crate::finding::{Finding, FindingKind, Severity, Span};
use crate::names::names;
use gaitfit_model::{shown, shown_number};

/// Relative difference of gains that are the same, after a recorder's rounding.
const SAME: f64 = 1e-4;
/// Desired velocity, rad/s, and torque, N·m, that are 0.
const NOTHING: f64 = 1e-6;

/// Columns of the motors' commands, each `samples × joints` or empty.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct MotorColumns {
    /// Position gains, N·m/rad.
    pub kp: Vec<f64>,
    /// Velocity gains, N·m·s/rad.
    pub kd: Vec<f64>,
    /// Desired velocities, rad/s.
    pub target_velocity: Vec<f64>,
    /// Feed-forward torques, N·m.
    pub feed_forward: Vec<f64>,
}

impl MotorColumns {
    /// Whether desired velocities or torques are anything but 0.
    pub fn drives(&self) -> bool {
        self.target_velocity.iter().chain(&self.feed_forward).any(|value| value.abs() > NOTHING)
    }
}

fn finding(kind: FindingKind, severity: Severity, joints: Vec<String>, message: String) -> Finding {
    Finding { kind, severity, joints, span: None, message }
}

/// Takes the gains of the columns where nobody has stated any, and tells where they change or are others than stated.
/// `place` gets where they are from.
pub fn gains(
    columns: &MotorColumns,
    time: &[f64],
    joints: &[String],
    gains: &mut Option<Gains>,
    place: &mut Option<String>,
) -> Vec<Finding> {
    let width = joints.len();
    // Gains count only if both are there for every sample and joint.
    let whole = |values: &[f64]| !values.is_empty() && values.len() == time.len() * width;
    if !(whole(&columns.kp) && whole(&columns.kd)) {
        return Vec::new();
    }
    let same = |a: f64, b: f64| (a - b).abs() <= SAME * a.abs().max(b.abs());
    let mut findings = Vec::new();
    let change = |values: &[f64]| {
        (width..values.len())
            .find(|&at| !same(values[at], values[at - width]))
            .map(|at| (at / width, at % width))
    };
    let changes = [("kp", &columns.kp), ("kd", &columns.kd)]
        .into_iter()
        .filter_map(|(name, values)| change(values).map(|(row, joint)| (row, joint, name, values)));
    // The earliest change is named, because the log is to be cut there.
    if let Some((row, joint, name, values)) = changes.min_by_key(|change| change.0) {
        let at = row * width + joint;
        let message = format!(
            "{name} of {} changes from {} to {} at {} s: a simulation of the log has one set of gains; cut the log there",
            shown(&joints[joint]),
            shown_number(values[at - width]),
            shown_number(values[at]),
            shown_number(time[row])
        );
        let span = Span { start: row, end: time.len(), from_s: time[row], to_s: time[time.len() - 1] };
        let mut finding =
            finding(FindingKind::GainsChange, Severity::Error, vec![joints[joint].clone()], message);
        finding.span = Some(span);
        findings.push(finding);
    }
    // If gains change, those of the first row hold up to the cut.
    let first = |values: &[f64]| values[..width].to_vec();
    let logged = Gains { kp: first(&columns.kp), kd: first(&columns.kd) };
    let usable = logged.kp.iter().chain(&logged.kd).all(|gain| gain.is_finite() && *gain >= 0.0);
    match gains {
        _ if !usable => findings.push(finding(
            FindingKind::NotFinite,
            Severity::Error,
            Vec::new(),
            "the columns kp_ and kd_ hold gains that are negative or no numbers; correct or remove them"
                .to_owned(),
        )),
        None => {
            *gains = Some(logged);
            *place = Some("the columns kp_ and kd_".to_owned());
        }
        // What someone has stated wins over the columns; a disagreement is told.
        Some(stated) => {
            let pairs = stated.kp.iter().zip(&logged.kp).chain(stated.kd.iter().zip(&logged.kd));
            if let Some((number, (stated, logged))) = pairs.enumerate().find(|(_, (a, b))| !same(**a, **b)) {
                let message = format!(
                    "the gain {} of {} is stated as {} and logged as {}; the stated one is taken",
                    if number < width { "kp" } else { "kd" },
                    shown(&joints[number % width]),
                    shown_number(*stated),
                    shown_number(*logged)
                );
                findings.push(finding(FindingKind::GainsChange, Severity::Warning, Vec::new(), message));
            }
        }
    }
    findings
}

/// Puts desired velocities and feed-forward torques into the position targets, where gains are known. Without targets or
/// gains, or with a gain of 0, what drives the motors is lost, and the finding is an error.
pub fn fold(
    columns: &MotorColumns,
    joints: &[String],
    gains: Option<&Gains>,
    target: Option<&mut Vec<f64>>,
) -> Vec<Finding> {
    if !columns.drives() {
        return Vec::new();
    }
    let what = "desired velocities or feed-forward torques (dqdes_, tauff_) drive the motors besides the position targets";
    let refuse = |joints: Vec<String>, why: String| {
        vec![finding(FindingKind::FeedForward, Severity::Error, joints, format!("{what}, and {why}"))]
    };
    let width = joints.len();
    let (Some(gains), Some(target)) = (gains, target) else {
        return refuse(
            Vec::new(),
            "what torque they make is known only with position targets (qdes_) and gains; record the targets, and state kp \
             and kd in the log"
                .to_owned(),
        );
    };
    // Idle motors have desired velocities beyond reason, and gains of 0.
    let torque = |at: usize| {
        let velocity = columns.target_velocity.get(at).copied().unwrap_or(0.0);
        gains.kd[at % width] * velocity + columns.feed_forward.get(at).copied().unwrap_or(0.0)
    };
    let count = target.len();
    let driven = |joint: usize| (joint..count).step_by(width).any(|at| torque(at).abs() > NOTHING);
    if !(0..width).any(driven) {
        return Vec::new();
    }
    // Without a position gain no target makes the torque.
    let without: Vec<usize> = (0..width).filter(|&joint| gains.kp[joint] <= 0.0 && driven(joint)).collect();
    if !without.is_empty() {
        let joint_names: Vec<String> = without.iter().map(|&joint| joints[joint].clone()).collect();
        let list = names(joint_names.iter().map(String::as_str));
        return refuse(
            joint_names,
            format!(
                "{list} have no position gain: a simulation needs a PD controller; record with kp above 0"
            ),
        );
    }
    for (at, target) in target.iter_mut().enumerate() {
        let kp = gains.kp[at % width];
        // A joint without a gain is not driven: that was refused above.
        if kp > 0.0 {
            *target += torque(at) / kp;
        }
    }
    let message = format!(
        "{what}; they are put into the targets: qdes + (kd · dqdes + tauff) / kp, which makes the same torque"
    );
    vec![finding(FindingKind::FeedForward, Severity::Note, Vec::new(), message)]
}
