//! Pendulum-less joints with a motor each, under a supervisor: enough to see what a robot would feel.

use std::time::Duration;

use gaitfit_policy::{Interface, Quantity, Term};
use gaitfit_robot::guard::GuardSettings;
use gaitfit_robot::robot::Motor;
use gaitfit_robot::unitree::Remote;
use gaitfit_robot::{
    Battery, Command, PerMotor, Phase, Postures, Reading, Robot, RobotState, Seal, Supervisor, Times,
};

/// Time between commands.
pub const TICK: Duration = Duration::from_millis(2);
/// Time between the policy's outputs.
pub const CONTROL: Duration = Duration::from_millis(20);
/// Inertia of each joint, kg·m², and its friction, N·m·s/rad.
const INERTIA: f32 = 0.04;
const FRICTION: f32 = 0.3;
/// Steps of the joints between commands.
const SUBSTEPS: usize = 4;

pub const STANDING: [f32; 12] = [-0.1, 0.8, -1.5, 0.1, 0.8, -1.5, -0.1, 1.0, -1.5, 0.1, 1.0, -1.5];

/// The built-in Go2.
pub fn go2() -> Robot {
    Robot::built_in("unitree-go2").unwrap()
}

/// Where a robot stands: a Go2 as policies have it, another part of the way from its rest to the middle of its ranges.
pub fn standing(robot: &Robot) -> PerMotor<f32> {
    if robot.name == "go2" {
        return STANDING.into();
    }
    robot.each(|motor| {
        let [low, high] = motor.range.unwrap_or([motor.lying; 2]);
        motor.lying + 0.3 * (0.5 * (low + high) - motor.lying)
    })
}

/// What a policy sees and moves that moves `motors` of a robot with the gains of its file, and rolls its wheels, which have
/// their other name.
pub fn interface(robot: &Robot, motors: &[usize]) -> Interface {
    let poses = standing(robot);
    let each = |value: &dyn Fn(usize) -> f32| motors.iter().map(|&k| f64::from(value(k))).collect::<Vec<_>>();
    let name = |motor: &Motor| format!("{}_joint", motor.aliases.first().unwrap_or(&motor.joint));
    let wheels = motors.iter().map(|&k| &robot.motors[k]).filter(|motor| motor.is_wheel());
    Interface {
        robot: robot.name.clone(),
        joints: motors.iter().map(|&k| name(&robot.motors[k])).collect(),
        default_pose: each(&|k| poses[k]),
        action_scale: vec![0.1; motors.len()],
        action_clip: None,
        kp: each(&|k| robot.motors[k].kp),
        kd: each(&|k| robot.motors[k].kd),
        velocity_joints: wheels.map(name).collect(),
        held: Vec::new(),
        control_dt: CONTROL.as_secs_f64(),
        gait_frequency: None,
        reference: None,
        history: Default::default(),
        observation: vec![Term::new(Quantity::JointPosition)],
        critic_observation: Vec::new(),
    }
}

/// A robot on the ground: joints that follow their motors, a level base.
#[derive(Clone)]
pub struct Toy {
    pub state: RobotState,
    /// Where joints stop, rad: a little outside of their ranges.
    stops: PerMotor<[f32; 2]>,
}

impl Toy {
    pub fn lying(robot: &Robot) -> Self {
        let battery = robot.guard.charge.map(|_| Battery { charge: 90, volts: 29.5, amps: 1.0 });
        Self {
            stops: robot.each(|motor| {
                let [low, high] = motor.range.unwrap_or([f32::NEG_INFINITY, f32::INFINITY]);
                [low - 0.08, high + 0.08]
            }),
            state: RobotState {
                q: robot.each(|motor| motor.lying),
                dq: robot.each(|_| 0.0),
                torque: robot.each(|_| 0.0),
                temperature: robot.each(|_| 30),
                error: robot.each(|_| 0),
                lost: robot.each(|_| 0),
                quaternion: [1.0, 0.0, 0.0, 0.0],
                gyroscope: [0.0; 3],
                accelerometer: [0.0, 0.0, 9.81],
                battery,
                tick: 1,
                remote: Remote::default(),
            },
        }
    }

    /// Two milliseconds under a command.
    pub fn step(&mut self, command: Option<&Command>) {
        let dt = TICK.as_secs_f32() / SUBSTEPS as f32;
        for _ in 0..SUBSTEPS {
            for motor in 0..self.stops.len() {
                let (q, dq) = (self.state.q[motor], self.state.dq[motor]);
                let torque = command.map_or(0.0, |command| command[motor].torque(q, dq));
                self.state.torque[motor] = torque;
                let dq = dq + dt * (torque - FRICTION * dq) / INERTIA;
                self.state.dq[motor] = dq;
                self.state.q[motor] = (q + dt * dq).clamp(self.stops[motor][0], self.stops[motor][1]);
            }
        }
        self.state.tick += 2;
    }

    pub fn reading(&self) -> Reading {
        Reading { state: self.state, seal: Seal::Right }
    }
}

/// Those of a robot under a policy with soft gains.
pub fn postures(robot: &Robot) -> Postures {
    Postures {
        lying: robot.each(|motor| motor.lying),
        standing: standing(robot),
        stand_kp: robot.each(|motor| motor.kp),
        stand_kd: robot.each(|motor| motor.kd),
        kp: robot.each(|motor| 0.5 * motor.kp),
        kd: robot.each(|motor| motor.kd.min(if robot.name == "go2" { 0.5 } else { f32::INFINITY })),
        damping: robot.each(|motor| motor.damping),
        rolls: robot.each(|_| false),
    }
}

/// A toy robot under a supervisor and a policy that marches on the spot.
pub struct Run {
    pub robot: Robot,
    pub toy: Toy,
    pub supervisor: Supervisor,
    pub now: Duration,
    pub command: Option<Command>,
}

impl Run {
    /// A Go2.
    pub fn new() -> Self {
        Self::with(go2())
    }

    pub fn with(robot: Robot) -> Self {
        let guard = GuardSettings::new(&robot, CONTROL);
        let supervisor = Supervisor::new(guard, postures(&robot), Times::default());
        Self { toy: Toy::lying(&robot), robot, supervisor, now: Duration::ZERO, command: None }
    }

    /// A Go2, armed.
    pub fn armed() -> Self {
        Self::armed_with(go2())
    }

    pub fn armed_with(robot: Robot) -> Self {
        let mut run = Self::with(robot);
        run.supervisor.read(run.now, &run.toy.reading());
        run.supervisor.arm(run.now).unwrap();
        run
    }

    /// Two milliseconds in which nothing is wrong.
    pub fn tick(&mut self) {
        let robot = self.robot.clone();
        self.tick_with(Some, |now| march(&robot, now));
    }

    /// Two milliseconds; `heard` is what the supervisor hears of the robot's message, `policy` what the policy says.
    pub fn tick_with(
        &mut self,
        heard: impl FnOnce(Reading) -> Option<Reading>,
        policy: impl FnOnce(Duration) -> Option<PerMotor<f32>>,
    ) {
        self.now += TICK;
        self.toy.step(self.command.as_ref());
        if let Some(reading) = heard(self.toy.reading()) {
            self.supervisor.read(self.now, &reading);
        }
        let acts = self.now.as_millis().is_multiple_of(CONTROL.as_millis());
        let walks = matches!(self.supervisor.phase(), Phase::Walk | Phase::Stop);
        let wanted = walks || self.supervisor.awaits_policy(self.now);
        if acts
            && wanted
            && let Some(targets) = policy(self.now)
        {
            self.supervisor.aim(self.now, targets);
        }
        self.command = self.supervisor.tick(self.now);
    }

    /// Until a phase; at most 10 s.
    pub fn until(&mut self, phase: Phase) {
        for _ in 0..5000 {
            if self.supervisor.phase() == phase {
                return;
            }
            self.tick();
        }
        panic!("{phase:?} is not reached; {:?} {:?}", self.supervisor.phase(), self.supervisor.reason());
    }

    pub fn for_ms(&mut self, ms: u64) {
        (0..ms / 2).for_each(|_| self.tick());
    }
}

/// A policy that marches on the spot at 2 Hz.
pub fn march(robot: &Robot, now: Duration) -> Option<PerMotor<f32>> {
    let wave = (std::f32::consts::TAU * 2.0 * now.as_secs_f32()).sin();
    let standing = standing(robot);
    Some(PerMotor::from_fn(standing.len(), |motor| {
        let side = if matches!(motor / 3, 0 | 3) { 1.0 } else { -1.0 };
        standing[motor] + [0.0, 0.2, -0.3][motor % 3] * (side * wave).max(0.0)
    }))
}
