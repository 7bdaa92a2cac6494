//! Twelve pendulum-less joints with a motor each, under a supervisor: enough to see what a robot would feel.

use std::time::Duration;

use gaitfit_robot::guard::GuardSettings;
use gaitfit_robot::unitree::{MOTORS, Remote};
use gaitfit_robot::{Battery, Command, Phase, Postures, Reading, RobotState, Seal, Supervisor, Times};

/// Time between commands.
pub const TICK: Duration = Duration::from_millis(2);
/// Time between the policy's outputs.
pub const CONTROL: Duration = Duration::from_millis(20);
/// Inertia of each joint, kg·m², and its friction, N·m·s/rad.
const INERTIA: f32 = 0.04;
const FRICTION: f32 = 0.3;
/// Steps of the joints between commands.
const SUBSTEPS: usize = 4;

pub const STANDING: [f32; MOTORS] = [-0.1, 0.8, -1.5, 0.1, 0.8, -1.5, -0.1, 1.0, -1.5, 0.1, 1.0, -1.5];

/// A robot on the ground: joints that follow their motors, a level base.
pub struct Toy {
    pub state: RobotState,
}

impl Toy {
    pub fn lying() -> Self {
        Self {
            state: RobotState {
                q: Postures::GO2_LYING,
                dq: [0.0; MOTORS],
                torque: [0.0; MOTORS],
                temperature: [30; MOTORS],
                quaternion: [1.0, 0.0, 0.0, 0.0],
                gyroscope: [0.0; 3],
                accelerometer: [0.0, 0.0, 9.81],
                battery: Some(Battery { charge: 90, volts: 29.5, amps: 1.0 }),
                tick: 1,
                remote: Remote::default(),
            },
        }
    }

    /// Two milliseconds under a command.
    pub fn step(&mut self, command: Option<&Command>) {
        let dt = TICK.as_secs_f32() / SUBSTEPS as f32;
        for _ in 0..SUBSTEPS {
            for motor in 0..MOTORS {
                let (q, dq) = (self.state.q[motor], self.state.dq[motor]);
                let torque = command.map_or(0.0, |command| command[motor].torque(q, dq));
                self.state.torque[motor] = torque;
                let dq = dq + dt * (torque - FRICTION * dq) / INERTIA;
                self.state.dq[motor] = dq;
                self.state.q[motor] = (q + dt * dq).clamp(-2.8, 4.6);
            }
        }
        self.state.tick += 2;
    }

    pub fn reading(&self) -> Reading {
        Reading { state: self.state, seal: Seal::Right }
    }
}

/// A toy robot under a supervisor and a policy that marches on the spot.
pub struct Run {
    pub toy: Toy,
    pub supervisor: Supervisor,
    pub now: Duration,
    pub command: Option<Command>,
}

impl Run {
    pub fn new() -> Self {
        let postures = Postures::go2(STANDING, [25.0; MOTORS], [0.5; MOTORS]);
        let supervisor = Supervisor::new(GuardSettings::go2(CONTROL), postures, Times::default());
        Self { toy: Toy::lying(), supervisor, now: Duration::ZERO, command: None }
    }

    /// Armed.
    pub fn armed() -> Self {
        let mut run = Self::new();
        run.supervisor.read(run.now, &run.toy.reading());
        run.supervisor.arm(run.now).unwrap();
        run
    }

    /// Two milliseconds in which nothing is wrong.
    pub fn tick(&mut self) {
        self.tick_with(Some, march);
    }

    /// Two milliseconds; `heard` is what the supervisor hears of the robot's message, `policy` what the policy says.
    pub fn tick_with(
        &mut self,
        heard: impl FnOnce(Reading) -> Option<Reading>,
        policy: impl FnOnce(Duration) -> Option<[f32; MOTORS]>,
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
pub fn march(now: Duration) -> Option<[f32; MOTORS]> {
    let wave = (std::f32::consts::TAU * 2.0 * now.as_secs_f32()).sin();
    Some(std::array::from_fn(|motor| {
        let side = if matches!(motor / 3, 0 | 3) { 1.0 } else { -1.0 };
        STANDING[motor] + [0.0, 0.2, -0.3][motor % 3] * (side * wave).max(0.0)
    }))
}
