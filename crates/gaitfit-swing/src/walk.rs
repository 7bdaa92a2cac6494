//! A log as a motion in time: joints, base and targets on an even, fine grid.

use crate::SwingError;
use crate::poses::Poses;
use gaitfit_log::{Gains, Trajectory};
use gaitfit_model::rotation::{IDENTITY, Quat, Vec3, blend, quat_of};
use gaitfit_model::{Model, Root};

/// The grid is at least this fine, s: swings of the fastest gaits last 0.1 s. A little above 2.5 ms, so that
/// rounding of a period of 20 or 5 ms does not ask for one more grid point a sample.
const FINE_S: f64 = 0.0026;
/// Noise of joint velocities, rad/s: below it their sign is not sure.
const SIGN_RATE: f64 = 0.05;
/// Samples further apart than this many periods have a gap between them, which is not interpolated.
const GAP: f64 = 3.5;
/// A log with fewer samples shows nothing.
const MIN_SAMPLES: usize = 8;
/// Max numbers of a grid, points times joints.
const MAX_NUMBERS: usize = 50_000_000;

/// Signals of one log, joints in the model's order; one row a grid point.
#[derive(Clone, Debug)]
pub struct Walk {
    /// Time between grid points, s.
    pub step: f64,
    /// Grid points between two samples of the log.
    pub per_sample: usize,
    /// Whether the log has samples near each grid point.
    pub valid: Vec<bool>,
    /// Positions, rad; `len × joints`.
    pub q: Vec<f64>,
    /// Velocities, rad/s; `len × joints`.
    pub dq: Vec<f64>,
    /// Orientation of the base, wxyz.
    pub quaternion: Vec<Quat>,
    /// Angular velocity of the base, rad/s, base frame.
    pub rates: Vec<Vec3>,
    /// Times of the log's samples, s, from the first.
    pub sample_times: Vec<f64>,
    /// Time from a row to the sending of its target, s.
    pub lead: f64,
    /// Targets at the log's samples, rad; `samples × joints`. NaN for joints that the log lacks.
    pub targets: Vec<f64>,
    /// Gains, one a joint: N·m/rad and N·m·s/rad. NaN for joints that the log lacks.
    pub gains: Vec<[f64; 2]>,
    /// Joints.
    pub joints: usize,
    /// Rate within which the sign of a joint's velocity is not sure, rad/s.
    pub sign_rate: f64,
    /// Poses of the limbs that follow from the positions and velocities above, computed once.
    pub(crate) poses: Poses,
}

impl Walk {
    /// Grid points.
    pub fn points(&self) -> usize {
        self.valid.len()
    }

    /// Positions at a grid point.
    pub fn q_at(&self, point: usize) -> &[f64] {
        &self.q[point * self.joints..(point + 1) * self.joints]
    }

    /// Velocities at a grid point.
    pub fn dq_at(&self, point: usize) -> &[f64] {
        &self.dq[point * self.joints..(point + 1) * self.joints]
    }

    /// The walks of all logs of one robot, see [`Self::new`].
    ///
    /// # Errors
    /// The first error of a log.
    pub fn all(model: &Model, logs: &[&Trajectory], threads: usize) -> Result<Vec<Self>, SwingError> {
        gaitfit_pool::map(logs.len(), threads, |log| Self::new(model, logs[log])).into_iter().collect()
    }

    /// Multiplies both gains of a joint.
    pub fn scale_gains(&mut self, joint: usize, factor: f64) {
        self.gains[joint].iter_mut().for_each(|gain| *gain *= factor);
    }

    /// From a log whose joints the model has, under any of their names. Joints that the log lacks rest at their reference.
    ///
    /// # Errors
    /// A log without targets, gains or, of a floating robot, orientation and rates of the base; joints that the robot
    /// lacks.
    pub fn new(model: &Model, log: &Trajectory) -> Result<Self, SwingError> {
        let columns = Columns::find(model, log)?;
        let Grid { step, per_sample, points } = Grid::over(log, model.joints.len())?;
        let (joints, start) = (model.joints.len(), log.time[0]);
        let mut walk = Self {
            step,
            per_sample,
            valid: vec![false; points],
            q: vec![0.0; points * joints],
            dq: vec![0.0; points * joints],
            quaternion: vec![model.bodies.first().map_or(IDENTITY, |body| body.quat); points],
            rates: vec![[0.0; 3]; points],
            sample_times: log.time.iter().map(|time| time - start).collect(),
            lead: log.lead.as_ref().map_or(0.0, |lead| lead.seconds),
            targets: vec![f64::NAN; log.len() * joints],
            gains: vec![[f64::NAN; 2]; joints],
            joints,
            sign_rate: SIGN_RATE,
            poses: Poses::default(),
        };
        walk.take_commands(model, log, &columns);
        walk.interpolate(log, &columns);
        walk.poses = Poses::new(model, &walk);
        Ok(walk)
    }

    /// Takes targets and gains of the log's joints, and the reference positions of the others.
    fn take_commands(&mut self, model: &Model, log: &Trajectory, columns: &Columns<'_>) {
        let (joints, width) = (self.joints, log.joints.len());
        for (joint, place) in columns.of_joint.iter().enumerate() {
            let Some(place) = *place else {
                let rest = model.joints[joint].reference;
                (0..self.points()).for_each(|point| self.q[point * joints + joint] = rest);
                continue;
            };
            self.gains[joint] = [columns.gains.kp[place], columns.gains.kd[place]];
            for sample in 0..log.len() {
                self.targets[sample * joints + joint] = columns.targets[sample * width + place];
            }
        }
    }

    /// Fills the grid from the samples around each of its points.
    fn interpolate(&mut self, log: &Trajectory, columns: &Columns<'_>) {
        let max_span = GAP * log.dt();
        let mut before = 0;
        for point in 0..self.points() {
            let at = point as f64 * self.step;
            while before + 2 < log.len() && self.sample_times[before + 1] <= at + 1e-9 {
                before += 1;
            }
            let span = self.sample_times[before + 1] - self.sample_times[before];
            let fraction = ((at - self.sample_times[before]) / span).clamp(0.0, 1.0);
            let between = Between { before, span, fraction };
            let joints_finite = self.set_joints(point, &between, log, columns);
            let base_finite = self.set_base(point, &between, columns);
            self.valid[point] = span > 0.0 && span < max_span && joints_finite && base_finite;
        }
    }

    /// Sets the joints at a grid point. Returns whether all values are finite.
    fn set_joints(
        &mut self,
        point: usize,
        between: &Between,
        log: &Trajectory,
        columns: &Columns<'_>,
    ) -> bool {
        let width = log.joints.len();
        let mut finite = true;
        for (joint, place) in columns.of_joint.iter().enumerate() {
            let Some(place) = *place else { continue };
            let (here, there) = (between.before * width + place, (between.before + 1) * width + place);
            let ends = [log.position[here], log.velocity[here], log.position[there], log.velocity[there]];
            let [q, dq] = hermite(ends, between.span, between.fraction);
            finite &= q.is_finite() && dq.is_finite();
            self.q[point * self.joints + joint] = q;
            self.dq[point * self.joints + joint] = dq;
        }
        finite
    }

    /// Sets a floating base at a grid point. Returns whether all values are finite.
    fn set_base(&mut self, point: usize, between: &Between, columns: &Columns<'_>) -> bool {
        let Some((quaternions, rates)) = columns.imu else { return true };
        let &Between { before, fraction, .. } = between;
        let after = before + 1;
        let quaternion = |sample: usize| quat_of(&quaternions[4 * sample..]);
        let turned = blend(quaternion(before), quaternion(after), fraction);
        let rate: Vec3 = std::array::from_fn(|k| {
            (1.0 - fraction) * rates[3 * before + k] + fraction * rates[3 * after + k]
        });
        self.quaternion[point] = turned;
        self.rates[point] = rate;
        turned.iter().chain(&rate).all(|x| x.is_finite())
    }

    /// Sign of a joint's velocity `lead` grid points later, smooth where it is not sure.
    pub(crate) fn sign(&self, joint: usize, point: usize, lead: usize) -> f64 {
        let dq = self.dq[(point + lead).min(self.points() - 1) * self.joints + joint];
        // Near 0, where noise decides the sign, x/√(x² + r²) is small.
        dq / dq.hypot(self.sign_rate)
    }

    /// Target of a joint at a time (s from the log's start) if it acts `delay` s after it was sent; the first target
    /// before there is one.
    pub fn target(&self, joint: usize, at: f64, delay: f64) -> f64 {
        let sent = at - delay - self.lead;
        // A target that is sent at this very time counts, whatever the rounding.
        let sample = self.sample_times.partition_point(|time| *time <= sent + 1e-9).saturating_sub(1);
        self.targets[sample * self.joints + joint]
    }
}

/// What a walk needs of a log.
struct Columns<'a> {
    targets: &'a [f64],
    gains: &'a Gains,
    /// Quaternions and rates of a floating base; absent if the base is fixed.
    imu: Option<(&'a [f64], &'a [f64])>,
    /// The log's column of each joint of the model; absent for joints that the log lacks.
    of_joint: Vec<Option<usize>>,
}

impl<'a> Columns<'a> {
    fn find(model: &Model, log: &'a Trajectory) -> Result<Self, SwingError> {
        let lacks = |what| SwingError::Lacks { log: name(log), what };
        if let Some(joint) = log.velocity_joints.first() {
            return Err(SwingError::VelocityTargets { log: name(log), joint: joint.clone() });
        }
        let targets = log.target.as_ref().ok_or_else(|| lacks("position targets (columns qdes_…)"))?;
        let gains =
            log.gains.as_ref().ok_or_else(|| lacks("PD gains (kp and kd in its header or log.toml)"))?;
        let imu = match model.root {
            Root::Floating => Some(imu(log).ok_or_else(|| {
                lacks("orientation and body rates of the base (roll, pitch, yaw or base_quat_…; wx, wy, wz)")
            })?),
            Root::Fixed => None,
        };
        let mut of_joint = vec![None; model.joints.len()];
        for (place, joint) in log.joints.iter().enumerate() {
            let Some(number) = model.find_joint(joint) else {
                return Err(SwingError::NoSuchJoint { log: name(log), joint: joint.clone() });
            };
            of_joint[number] = Some(place);
        }
        Ok(Self { targets, gains, imu, of_joint })
    }
}

/// The log's name in messages.
fn name(log: &Trajectory) -> String {
    log.source.as_ref().map_or_else(|| "the log".to_owned(), |path| path.display().to_string())
}

/// Quaternions and rates of the base.
fn imu(log: &Trajectory) -> Option<(&[f64], &[f64])> {
    let base = log.base.as_ref()?;
    Some((base.quaternion.as_ref()?, base.angular_velocity.as_ref()?))
}

/// An even, fine grid in time.
struct Grid {
    step: f64,
    per_sample: usize,
    points: usize,
}

impl Grid {
    /// From the first to the last sample of a log.
    fn over(log: &Trajectory, joints: usize) -> Result<Self, SwingError> {
        let samples = log.len();
        if samples < MIN_SAMPLES {
            return Err(SwingError::Short { log: name(log), samples });
        }
        let period = log.dt();
        let per_sample = (period / FINE_S).ceil().max(1.0) as usize;
        let step = period / per_sample as f64;
        let points = ((log.duration() / step) + 1e-6).floor() as usize + 1; // 1e-6: rounding.
        if points.saturating_mul(joints.max(1)) > MAX_NUMBERS {
            return Err(SwingError::Long { log: name(log), seconds: log.duration() });
        }
        Ok(Self { step, per_sample, points })
    }
}

/// A time between two samples that follow each other.
struct Between {
    /// The sample before.
    before: usize,
    /// Time between both samples, s.
    span: f64,
    /// Part of the span that has passed, 0 to 1.
    fraction: f64,
}

/// Value and derivative of the cubic with the given values and slopes at both ends of `span`.
fn hermite([q0, dq0, q1, dq1]: [f64; 4], span: f64, x: f64) -> [f64; 2] {
    let (m0, m1) = (span * dq0, span * dq1);
    let rise = q1 - q0;
    let b = 3.0 * rise - 2.0 * m0 - m1;
    let c = m0 + m1 - 2.0 * rise;
    [q0 + x * (m0 + x * (b + x * c)), (m0 + x * (2.0 * b + x * 3.0 * c)) / span]
}
