//! PD gains and action scales of the joints.

use super::InitError;
use super::anatomy::{Anatomy, path};
use super::rotors::Rotors;
use super::sizes::{Sizes, digits, tidy};
use gaitfit_model::kinematics::{Frame, body_frames};
use gaitfit_model::rotation::{dot, sub};
use gaitfit_model::{Integrator, JointKind, Model, listed, shown};
use gaitfit_physics::Robot;

/// kp over m g l: gives the built-in Go2 (15.2 kg, legs of 0.3 m) its 25 N·m/rad.
const STIFFNESS: f64 = 0.56;
/// kp of a slide over m g / l: a telescopic leg of two that carry the robot gives way by a twentieth of its length.
const SLIDE_STIFFNESS: f64 = 10.0;
/// kd over kp, s: the built-in Go2's 0.5 N·m·s/rad over 25 N·m/rad.
const DAMPING: f64 = 0.02;
/// Gains of the file are taken where they are within this factor of those by size.
const LIKELY: f64 = 2.5;
/// Target change per unit action, rad: that of the built-in task.
const SCALE: f64 = 0.25;
/// Longest physics step, and the control period, s: those of the built-in task, 200 Hz and 50 Hz.
const STEP: f64 = 0.005;
const PERIOD: f64 = 0.02;
/// Max number of physics steps in a control period: steps of 1 ms.
const MAX_SUBSTEPS: f64 = 20.0;
/// Largest kp h²/I and kd h/I, h the physics step and I the inertia that a joint feels in the air: beyond 4 and 2 a
/// joint shakes in the simulation. The Go2's calves have 0.4 and 1.6.
const STIFFEST: f64 = 1.0;
const THICKEST: f64 = 1.6;
/// The same for held joints: smaller, because a limb has many of them and their eigenvalues add up (see [`substeps`]).
const HELD_STIFFEST: f64 = 0.1;
const HELD_THICKEST: f64 = 0.2;
/// How far a held joint sags under what hangs on it, rad.
const SAG: f64 = 0.1;

/// Where the gains of the legs come from.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum Source {
    /// The file's position actuators where they are likely, else the robot's size.
    #[default]
    Likely,
    /// The file's position actuators, whatever they are.
    Servos,
    /// This factor of those by the robot's size.
    Size(f64),
}

/// Gains and scales, one a joint of the model.
#[derive(Clone, Debug, PartialEq)]
pub struct Gains {
    /// N·m/rad, of slides N/m.
    pub kp: Vec<f64>,
    /// N·m·s/rad, of slides N·s/m.
    pub kd: Vec<f64>,
    /// rad, of wheels rad/s, of slides m; only for joints that the policy moves.
    pub scale: Vec<f64>,
    /// Physics steps in a control period.
    pub substeps: usize,
    /// Rotor inertia where the robot's own file has none.
    pub rotors: Option<Rotors>,
    /// Source of the gains, in words.
    pub how: String,
    /// Doubts about the gains, a sentence each.
    pub doubts: Vec<String>,
}

/// Gains of a position actuator, at the joint.
pub fn servo(model: &Model, joint: usize) -> Option<[f64; 2]> {
    let mut servos = model.actuators.iter().filter(|actuator| actuator.joint == joint);
    let (actuator, other) = (servos.next()?, servos.next());
    // The gear counts twice: from the joint's angle to the actuator's length, and from the actuator's force to the
    // torque.
    let gear = actuator.gear * actuator.gear;
    // MuJoCo's `position` actuator has the force kp ctrl − kp q − kv q̇: its gain is kp, its bias (0, −kp, −kv).
    let position = other.is_none() && actuator.gain > 0.0 && actuator.bias[1] == -actuator.gain;
    // Zero is added because a kv of 0 would give −0.
    position.then(|| [gear * actuator.gain, gear * (-actuator.bias[2]).max(0.0) + 0.0])
}

/// The quantities from which gains are chosen.
struct Chooser<'a> {
    model: &'a Model,
    anatomy: &'a Anatomy,
    /// kp over m g l.
    stiffness: f64,
    /// m g l of the robot, N·m.
    unit: f64,
    /// l, m.
    leg: f64,
    /// Largest command forward, m/s.
    forward: f64,
    /// Inertia that each joint feels in the air, kg·m² or kg.
    inertia: Vec<f64>,
    /// Torque of a usual motor of hinges, N·m, and force of one of slides, N.
    usual_effort: [Option<f64>; 2],
    /// Gains of the file's position actuators.
    servos: Vec<Option<[f64; 2]>>,
    /// Gains that hold each joint in the pose.
    held: Vec<f64>,
}

impl<'a> Chooser<'a> {
    fn new(
        model: &'a Model,
        anatomy: &'a Anatomy,
        angles: &[f64],
        sizes: &Sizes,
        source: Source,
    ) -> Result<Self, InitError> {
        let stiffness = match source {
            Source::Size(factor) => STIFFNESS * factor,
            _ => STIFFNESS,
        };
        let params = Robot::nominal(model).params(model);
        let params = params.map_err(|error| InitError::Robot(error.to_string()))?;
        // The median is the usual motor: single strong or weak joints do not move it.
        let efforts = |kind: JointKind| {
            let of_kind = anatomy.moved.iter().filter(|&&joint| model.joints[joint].kind == kind);
            median(of_kind.filter_map(|&joint| model.effort(joint)).collect())
        };
        Ok(Self {
            model,
            anatomy,
            stiffness,
            unit: sizes.mass * sizes.gravity * sizes.leg,
            leg: sizes.leg,
            forward: sizes.forward,
            inertia: params.joints.iter().map(|joint| joint.weight).collect(),
            usual_effort: [JointKind::Hinge, JointKind::Slide].map(efforts),
            servos: (0..model.joints.len()).map(|joint| servo(model, joint)).collect(),
            held: held(model, angles, sizes.gravity),
        })
    }

    /// kp by the robot's size; less for joints with weaker motors.
    fn by_size(&self, joint: usize) -> f64 {
        let kind = self.model.joints[joint].kind;
        // A weak motor then reaches its torque limit at the same distance from the target as a usual one.
        let weak = match (self.model.effort(joint), self.usual_effort[kind as usize]) {
            (Some(effort), Some(usual)) if usual > 0.0 => (effort / usual).min(1.0),
            _ => 1.0,
        };
        self.stiffness_of(kind) * weak
    }

    /// kp of a usual joint by the robot's size, N·m/rad or N/m.
    fn stiffness_of(&self, kind: JointKind) -> f64 {
        match kind {
            JointKind::Hinge => self.stiffness * self.unit,
            JointKind::Slide => {
                let factor = self.stiffness / STIFFNESS;
                factor * SLIDE_STIFFNESS * self.unit / (self.leg * self.leg)
            }
        }
    }

    /// kp of the file's position actuators over that by size; `None` if a joint of the legs has none.
    fn ratio(&self) -> Option<f64> {
        let moved = || self.anatomy.moved.iter();
        let ratios: Vec<f64> =
            moved().filter_map(|&joint| Some(self.servos[joint]?[0] / self.by_size(joint))).collect();
        median(ratios).filter(|_| moved().all(|&joint| self.servos[joint].is_some()))
    }

    /// kp, kd and the scale of actions of a joint; whether the robot's inertia bounds its gains. `takes_servos`: legs have the
    /// gains of the file.
    fn choose(&self, joint: usize, takes_servos: bool) -> ([f64; 3], bool) {
        // Gains on a joint without a motor would be torques from nowhere.
        if self.anatomy.passive.contains(&joint) {
            return ([0.0, 0.0, SCALE], false);
        }
        let (model, inertia) = (self.model, self.inertia[joint]);
        if let Some(radius) = self.anatomy.wheel_radius(model, joint) {
            return self.roll(joint, radius);
        }
        let moved = self.anatomy.moved.contains(&joint);
        let [stiff, thick] = if moved { [STIFFEST, THICKEST] } else { [HELD_STIFFEST, HELD_THICKEST] };
        // Bounds at which the simulation of this joint stays stable with the usual physics step.
        let (stiffest, thickest) = (stiff * inertia / (STEP * STEP), thick * inertia / STEP);
        let [p, d] = match (moved, self.servos[joint]) {
            (true, Some([p, d])) if takes_servos && d > 0.0 => [p, d],
            (true, Some([p, _])) if takes_servos => [p, (DAMPING * p - model.joints[joint].damping).max(0.0)],
            (true, _) => [self.by_size(joint), DAMPING * self.by_size(joint)],
            (false, _) => {
                let sag = model.joints[joint].kind.like("rad", SAG);
                // More stiffness than this is of no use: the motor cannot give the torque at the allowed sag.
                let weakest = model.effort(joint).unwrap_or(f64::INFINITY) / sag;
                let p = self.held[joint].min(weakest).min(stiffest);
                // kd = 2 ζ √(kp I) with a damping ratio ζ of 0.7.
                [p, 1.4 * (p * inertia).sqrt()]
            }
        };
        // Above zero: the scale divides by it.
        let kp = tidy(p.min(stiffest)).max(1e-3);
        // A unit of action is a torque of at most half of what the motor has.
        let of_leg = |angle: f64| match model.joints[joint].kind {
            JointKind::Hinge => angle,
            // As far as a hinge moves the foot with a lever of a third of the leg's length.
            JointKind::Slide => angle * self.leg / 3.0,
        };
        let torque = model.effort(joint).map_or(of_leg(SCALE), |effort| 0.5 * effort / kp);
        let scale = digits(of_leg(SCALE).min(torque).max(of_leg(0.1)), 2);
        ([kp, tidy(d.min(thickest)), scale], moved && (p > stiffest || d > thickest))
    }

    /// Gains of a wheel: a unit of action is the largest command, and from a standstill half of the motor's torque.
    fn roll(&self, joint: usize, radius: f64) -> ([f64; 3], bool) {
        // Above zero: the gain divides by it.
        let speed = digits(self.forward / radius, 2).max(1e-3);
        let torque = self.model.effort(joint).map_or(f64::INFINITY, |effort| 0.5 * effort);
        // At most the torque that a unit of action asks of a usual hinge.
        let torque = torque.min(SCALE * self.stiffness * self.unit);
        let thickest = THICKEST * self.inertia[joint] / STEP;
        let wanted = torque / speed;
        ([0.0, tidy(wanted.min(thickest)).max(1e-3), speed], wanted > thickest)
    }

    /// Where the gains are from, in words; `ratio` as of [`Self::ratio`].
    fn how(&self, source: Source, takes_servos: bool, ratio: Option<f64>) -> String {
        let lacks_kv = |&joint: &usize| self.servos[joint].is_some_and(|[_, d]| d == 0.0);
        // Damping that the file does not state is a guess, and is told as one.
        if takes_servos && self.anatomy.moved.iter().any(lacks_kv) {
            return format!(
                "kp of the file's position actuators, which state no kv: kd = {DAMPING} s · kp less the joint's damping (a guess)"
            );
        }
        if takes_servos {
            return "kp and kd of the file's position actuators".to_owned();
        }
        let (stiffness, shown) = (self.stiffness, tidy(self.stiffness));
        let mut how = format!(
            "kp = {shown:?} m g l = {:?} N·m/rad, less for joints with weaker motors; kd = {DAMPING} s · kp (a guess)",
            tidy(stiffness * self.unit)
        );
        if self.model.has_slides() {
            let slides = tidy(self.stiffness_of(JointKind::Slide));
            how.push_str(&format!("; slides: {SLIDE_STIFFNESS} m g / l = {slides:?} N/m"));
        }
        if let Some(ratio) = ratio.filter(|_| source == Source::Likely) {
            // As a factor above 1 in both directions, with the word that says which.
            let times = if ratio > 1.0 { tidy(ratio) } else { tidy(1.0 / ratio) };
            let than = if ratio > 1.0 { "stiffer" } else { "softer" };
            how.push_str(&format!(
                "; the file's position actuators are {times:?} times {than}, which trains badly"
            ));
        }
        how
    }
}

impl Gains {
    /// In the pose `angles` (rad, model order). `written`: the rotors that `init` wrote into the robot's file.
    pub fn new(
        model: &Model,
        anatomy: &Anatomy,
        angles: &[f64],
        sizes: &Sizes,
        source: Source,
        written: Option<Rotors>,
    ) -> Result<Self, InitError> {
        let mut chooser = Chooser::new(model, anatomy, angles, sizes, source)?;
        let ratio = chooser.ratio();
        let takes_servos = match source {
            Source::Likely => ratio.is_some_and(|ratio| (1.0 / LIKELY..=LIKELY).contains(&ratio)),
            Source::Servos => ratio.is_some(),
            Source::Size(_) => false,
        };
        let rotors = written.or_else(|| Rotors::guess(model, anatomy, sizes));
        let unwritten = rotors.map_or(0.0, |rotors| rotors.unwritten());
        // Every robot of the training has at least this rotor, so the gains need not suit bare links. When they had
        // to, ankles of humanoids got a damping ratio of 0.03 to 0.07.
        chooser.inertia.iter_mut().for_each(|inertia| *inertia += unwritten);
        let (mut kp, mut kd, mut scale) = (Vec::new(), Vec::new(), Vec::new());
        let mut bounded = Vec::new();
        for joint in 0..model.joints.len() {
            let ([stiffness, damping, unit], is_bounded) = chooser.choose(joint, takes_servos);
            if is_bounded {
                bounded.push(model.joints[joint].name.clone());
            }
            kp.push(stiffness);
            kd.push(damping);
            scale.push(unit);
        }
        let mut doubts = Vec::new();
        if !bounded.is_empty() {
            doubts.push(format!(
                "lowered where a joint has so little inertia that physics steps of {STEP} s would shake it ({}); motors \
                 have a rotor: give the joints their armature",
                listed(bounded.iter().map(|name| shown(name)), 3)
            ));
        }
        let substeps = substeps(model, &kp, &kd, &chooser.inertia);
        // The built-in task has 4.
        if substeps > 4 {
            doubts.push(format!(
                "{substeps} physics steps of {:?} s in a control period: gains and damping need short ones",
                digits(PERIOD / substeps as f64, 3)
            ));
        }
        if let Some(Rotors { smallest, largest, .. }) = rotors {
            doubts.push(format!(
                "the file gives the legs no rotor inertia (armature), and light links shake without one. In training robots have \
                 {smallest:?} to {largest:?} kg·m² (a guess), in evaluations the smallest. State armature in the file if you know it"
            ));
        }
        Ok(Self { kp, kd, scale, substeps, rotors, how: chooser.how(source, takes_servos, ratio), doubts })
    }
}

/// Physics steps in a control period with which the joints do not shake. In a semi-implicit step of length h that takes
/// damping from before, h d must be below 2 and h² k below 4, d and k the largest eigenvalues of M⁻¹ times the gains. Those
/// of a limb are at most the sums over its joints, and on robots with light last links a third of them.
fn substeps(model: &Model, kp: &[f64], kd: &[f64], inertia: &[f64]) -> usize {
    // Otherwise the integrator takes the joints' own damping from the end of the step, which bounds no step.
    let explicit = model.options.integrator == Integrator::Euler && !model.options.eulerdamp;
    let (mut most_d, mut most_k) = (0.0_f64, 0.0_f64);
    // The worst chain of joints from the base decides.
    for body in 0..model.bodies.len() {
        let (mut d, mut k) = (0.0, 0.0);
        for joint in path(model, body) {
            let damping = if explicit { model.joints[joint].damping } else { 0.0 };
            d += (kd[joint] + damping) / inertia[joint];
            k += kp[joint] / inertia[joint];
        }
        (most_d, most_k) = (most_d.max(d), most_k.max(k));
    }
    // With eigenvalues of a third of the sums the limits are h = 6 / d and h² = 12 / k, so half and a sixth of them
    // leave room. With eigenvalues as large as the sums they are 2 / d and 4 / k.
    let step = (3.0 / most_d).min((2.0 / most_k).sqrt()).min(STEP);
    // The subtraction takes rounding away: 0.02 / 0.005 must not become 5 steps.
    let steps = (PERIOD / step - 1e-9).ceil();
    if steps.is_finite() { steps.clamp(PERIOD / STEP, MAX_SUBSTEPS) as usize } else { MAX_SUBSTEPS as usize }
}

fn median(mut values: Vec<f64>) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

/// For each joint the stiffness with which it sags by [`SAG`] (slides: by the corresponding length) at most, in any
/// orientation: the weight of what hangs on it times the distance of that mass.
fn held(model: &Model, angles: &[f64], gravity: f64) -> Vec<f64> {
    let frames = body_frames(model, &Frame::WORLD, angles);
    let paths: Vec<Vec<usize>> = (0..model.bodies.len()).map(|body| path(model, body)).collect();
    // The centre of all mass that hangs on the joint; its distance is the longest lever of its weight.
    let inertia_about = |joint: usize| {
        let (mut mass, mut moment) = (0.0, [0.0; 3]);
        for ((body, frame), path) in model.bodies.iter().zip(&frames).zip(&paths) {
            if path.contains(&joint) {
                let centre = frame.point(body.ipos);
                mass += body.mass;
                (0..3).for_each(|k| moment[k] += body.mass * centre[k]);
            }
        }
        let joint = &model.joints[joint];
        let arm = match joint.kind {
            JointKind::Hinge => {
                let anchor = frames[joint.body].point(joint.pos).map(|x| mass * x);
                let arm = sub(moment, anchor);
                dot(arm, arm).sqrt()
            }
            JointKind::Slide => mass,
        };
        (gravity * arm / joint.kind.like("rad", SAG)).max(joint.kind.like("N·m/rad", 1.0))
    };
    (0..model.joints.len()).map(inertia_about).collect()
}
