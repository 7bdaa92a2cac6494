//! A simulated robot that hangs in its ropes, with the noise of a real one and one fault.

use std::collections::VecDeque;
use std::sync::OnceLock;
use std::time::Duration;

use gaitfit_model::Model;
use gaitfit_model::rotation::{Quat, from_rpy, inverse, product, rotate, rotate_back};
use gaitfit_random::{Purpose, Stream};
use gaitfit_robot::link::{Link, Simulated, hanging_go2, simulation};
use gaitfit_robot::preflight::{Finding, Flight, Listened, Moved, Turns, fly, listen, moved, sampled};
use gaitfit_robot::{Command, Reading, Robot, RobotError};
use gaitfit_sim::Batch;

/// What is wrong with the robot.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Fault {
    None,
    /// Readings of these motors are exchanged.
    SwappedReadings(usize, usize),
    /// Commands to them are.
    SwappedCommands(usize, usize),
    /// Both are, so that the names alone are wrong.
    SwappedBoth(usize, usize),
    /// The angle of this motor is read with the other sign.
    Sign(usize),
    /// This motor reads so many rad too much, and its controller with it.
    Zero(usize, f32),
    /// The inertial unit is mounted so: roll, pitch, yaw, degrees.
    Mounted([f64; 3]),
    /// Only its accelerometer is.
    Accelerometer([f64; 3]),
    /// Its quaternion comes as x, y, z, w.
    Order,
    /// Its gyro reads so much about this axis, rad/s.
    Bias(usize, f32),
    /// Its gyro has this factor.
    GyroFactor(f32),
    /// So many of a hundred messages are lost.
    Lost(u32),
    /// Every so many messages come twice.
    Twice(u32),
    /// Commands act so many ms late.
    Late(u64),
    /// This motor does not turn.
    Sticks(usize),
    /// This motor takes this part of its gains.
    Gains(usize, f32),
    /// This motor reads so far beyond the upper end of its range, rad, and does not turn.
    Beyond(usize, f32),
    /// The angle of this motor is no number in every hundredth message.
    NotFinite(usize),
    /// This motor is at this temperature, °C.
    Hot(usize, i16),
    /// The battery is at this charge, %.
    Charge(u8),
    /// Another program sends commands.
    Other,
    /// The accelerometer reads in g.
    InG,
    /// This motor reports an error number.
    Error(usize),
    /// A joint moves by itself so far, rad.
    Restless(usize, f32),
}

/// The base over time, as a person or its ropes move it.
pub type Pose = fn(f64) -> Quat;

/// It sways a little, at a heading of 40°.
pub fn sways(time: f64) -> Quat {
    from_rpy(
        0.02 + 0.01 * (1.9 * time).sin(),
        -0.015 + 0.008 * (1.3 * time).cos(),
        0.7 + 0.01 * (0.5 * time).sin(),
    )
}

pub fn hung() -> &'static Model {
    static MODEL: OnceLock<Model> = OnceLock::new();
    MODEL.get_or_init(|| hanging_go2().unwrap())
}

pub fn go2() -> Robot {
    Robot::built_in("unitree-go2").unwrap()
}

/// Its link.
pub struct Hung<'a> {
    body: Simulated<'a>,
    fault: Fault,
    pose: Pose,
    noise: Stream,
    step: u32,
    /// Where a stuck joint is, rad.
    stuck: Option<f32>,
    /// The last command that was taken.
    last: Option<Command>,
    /// Commands under way, ms.
    commands: VecDeque<(u64, Command)>,
    now: u64,
}

/// Noise of angles, velocities, torques, gyro and accelerometer (standard deviations).
pub const NOISE: [f32; 5] = [2e-5, 0.01, 0.02, 0.004, 0.03];
/// Step of an encoder, rad.
const ENCODER: f32 = 1e-4;

impl<'a> Hung<'a> {
    pub fn new(batch: &'a Batch, fault: Fault, pose: Pose, seed: u64) -> Self {
        Self {
            body: Simulated::new(batch, &go2()).unwrap(),
            fault,
            pose,
            noise: Stream::new(seed, Purpose::OBSERVATION_NOISE),
            step: 0,
            stuck: None,
            last: None,
            commands: VecDeque::new(),
            now: 0,
        }
    }

    /// A command as the motors take it.
    fn taken(&self, command: &Command) -> Command {
        let mut taken = *command;
        match self.fault {
            Fault::SwappedCommands(a, b) | Fault::SwappedBoth(a, b) => taken.swap(a, b),
            Fault::Zero(motor, by) => taken[motor].q -= by,
            Fault::Gains(motor, part) => {
                taken[motor].kp *= part;
                taken[motor].kd *= part;
            }
            _ => {}
        }
        taken
    }

    /// A message as this robot sends it; `None` where it is lost.
    fn sent(&mut self, age: Duration, reading: &Reading) -> Option<Reading> {
        let mut reading = *reading;
        let draws = self.noise.step(self.step);
        self.step += 1;
        let mut number = 0;
        let mut draw = |size: f32| {
            number += 1;
            size * draws.normal(number) as f32
        };
        let state = &mut reading.state;
        let count = state.q.len();
        for motor in 0..count {
            state.q[motor] = ((state.q[motor] + draw(NOISE[0])) / ENCODER).round() * ENCODER;
            state.dq[motor] += draw(NOISE[1]);
            state.torque[motor] += draw(NOISE[2]);
        }
        let time = (self.now as f64) * 1e-3 - age.as_secs_f64();
        let (q, next) = ((self.pose)(time), (self.pose)(time + 1e-3));
        let turn = product(inverse(q), next);
        let mut gyro: [f64; 3] = std::array::from_fn(|k| 2.0 * turn[k + 1] / 1e-3 * turn[0].signum());
        let mut pull = rotate_back(q, [0.0, 0.0, 9.81]);
        let mut attitude = q;
        if let Fault::Mounted(degrees) = self.fault {
            let of_base = rpy(degrees);
            attitude = product(q, of_base);
            gyro = rotate(inverse(of_base), gyro);
            pull = rotate(inverse(of_base), pull);
        }
        if let Fault::Accelerometer(degrees) = self.fault {
            pull = rotate(inverse(rpy(degrees)), pull);
        }
        state.quaternion = attitude.map(|x| x as f32);
        state.gyroscope = gyro.map(|x| x as f32 + draw(NOISE[3]));
        state.accelerometer = pull.map(|x| x as f32 + draw(NOISE[4]));
        let uniform = draws.uniform(number + 1);
        match self.fault {
            Fault::SwappedReadings(a, b) | Fault::SwappedBoth(a, b) => {
                state.q.swap(a, b);
                state.dq.swap(a, b);
                state.torque.swap(a, b);
            }
            Fault::Sign(motor) => {
                state.q[motor] *= -1.0;
                state.dq[motor] *= -1.0;
            }
            Fault::Zero(motor, by) => state.q[motor] += by,
            Fault::Order => state.quaternion.rotate_left(1),
            Fault::Bias(axis, by) => state.gyroscope[axis] += by,
            Fault::GyroFactor(factor) => state.gyroscope = state.gyroscope.map(|x| factor * x),
            Fault::Lost(percent) if uniform < f64::from(percent) / 100.0 => return None,
            Fault::Sticks(motor) => {
                state.q[motor] = *self.stuck.get_or_insert(state.q[motor]);
                state.dq[motor] = 0.0;
                // Its motor pulls all the same.
                state.torque[motor] = self.last.map_or(0.0, |last| last[motor].torque(state.q[motor], 0.0));
            }
            Fault::Beyond(motor, by) => {
                state.q[motor] = go2().limits().upper[motor] + by;
                state.dq[motor] = 0.0;
            }
            Fault::NotFinite(motor) if self.step.is_multiple_of(100) => state.q[motor] = f32::NAN,
            Fault::Hot(motor, degrees) => state.temperature[motor] = degrees,
            Fault::Charge(charge) => {
                if let Some(battery) = &mut state.battery {
                    battery.charge = charge;
                }
            }
            Fault::InG => state.accelerometer = state.accelerometer.map(|x| x / 9.81),
            Fault::Error(motor) => state.error[motor] = 4,
            Fault::Restless(motor, by) => state.q[motor] += by * (2.0 * time as f32).sin(),
            _ => {}
        }
        Some(reading)
    }
}

fn rpy(degrees: [f64; 3]) -> Quat {
    let [roll, pitch, yaw] = degrees.map(f64::to_radians);
    from_rpy(roll, pitch, yaw)
}

impl Link for Hung<'_> {
    fn receive(&mut self, now: Duration, each: &mut dyn FnMut(Duration, &Reading)) -> Result<u64, String> {
        let due = now.as_millis() as u64;
        while self.now < due {
            self.now += 1;
            while self.commands.front().is_some_and(|(at, _)| *at <= self.now) {
                if let Some((_, command)) = self.commands.pop_front() {
                    let taken = self.taken(&command);
                    self.last = Some(taken);
                    self.body.send(&taken)?;
                }
            }
            let mut came = Vec::new();
            self.body
                .receive(Duration::from_millis(self.now), &mut |age, reading| came.push((age, *reading)))?;
            for (age, reading) in came {
                if let Some(reading) = self.sent(age, &reading) {
                    let age = age + Duration::from_millis(due - self.now);
                    each(age, &reading);
                    if matches!(self.fault, Fault::Twice(every) if self.step.is_multiple_of(every)) {
                        each(age, &reading);
                    }
                }
            }
        }
        Ok(u64::from(self.fault == Fault::Other && due.is_multiple_of(10)))
    }

    fn send(&mut self, command: &Command) -> Result<(), String> {
        let late = if let Fault::Late(ms) = self.fault { ms } else { 0 };
        self.commands.push_back((self.now + late, *command));
        Ok(())
    }
}

/// A clock of a test.
#[derive(Default)]
pub struct Given(u64);

impl Turns for Given {
    fn next(&mut self) -> Duration {
        self.0 += 2;
        Duration::from_millis(self.0)
    }
}

/// What listening to such a robot shows.
pub fn listened(fault: Fault, pose: Pose, seed: u64) -> (Listened, Vec<Finding>) {
    let batch = simulation(hung()).unwrap();
    let mut link = Hung::new(&batch, fault, pose, seed);
    let (heard, others) = listen(&mut link, &mut Given::default(), Duration::from_secs(4), &|| None).unwrap();
    Listened::new(&heard, others, &go2(), false)
}

/// What moving it shows; an error where it may not be armed.
pub fn flown(fault: Fault, seed: u64) -> Result<(Moved, Vec<Finding>), RobotError> {
    let batch = simulation(hung()).unwrap();
    let mut link = Hung::new(&batch, fault, sways, seed);
    let robot = go2();
    let flight = Flight::new(&robot, robot.guard(Duration::from_millis(2)));
    let flown = fly(&mut link, &mut Given::default(), flight, &mut |_| {}, &|| None)?;
    let rows = sampled(&flown);
    Ok(moved(&flown, &rows, &robot, Some(&gaitfit_model::builtin::go2().unwrap())))
}
