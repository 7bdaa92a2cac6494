//! Gears: play and compliance between each motor and its link.

use super::Modify;
use crate::smooth::dry_friction;
use crate::{Drive, Owner, Params, Real, Settings, State};

/// Numbers that a gear remembers: the link's angle, velocity and acceleration less the motor's.
const MEMORY: usize = 3;
/// Compliance of a gear that counts as rigid, rad/(N·m).
const RIGID: f64 = 2e-4;
/// Damping of a gear over its stiffness, s.
const RETARDATION: f64 = 2e-3;
/// Smallest inertia of a rotor, kg·m².
const ROTOR: f64 = 1e-6;

/// Gears with `play` and `compliance` on all joints: outside the step the state is that of the motors, where encoders
/// and controllers are; inside it is that of the links.
///
/// Motor and link are two inertias with a spring in a gap between them (the dead-zone model of Nordin and Gutman 2002,
/// "Controlling mechanical systems with backlash: a survey", Automatica 38). A step of backward Euler for the motor gives
/// the torque in the gear, which is linear in the link's velocity v' at the end of the step: τ = α − β v'. α enters the
/// link's torque and h·β its inertia, so a stiff gear needs no small steps, and a rigid one without play adds the rotor's
/// inertia. The link's velocity, predicted from its last acceleration, decides on which flank the gear lies and whether
/// friction holds the rotor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gears {
    /// Joints of the robot.
    pub joints: usize,
}

/// What a gear does to its link in one step, and what its motor does then.
#[derive(Clone, Copy, Debug)]
pub struct Engaged<T> {
    /// Torque on the link at velocity 0 of the link, N·m.
    pub torque: T,
    /// Minus the derivative of the torque by the link's velocity at the end of the step, N·m·s/rad.
    pub resistance: T,
    /// The motor's velocity after the step without a torque in the gear, rad/s.
    rate: T,
    /// What a torque in the gear takes from it, rad/s for each N·m.
    mobility: T,
    /// The motor's angle (rad) and velocity (rad/s) before the step.
    motor: [T; 2],
}

// Zeros at the start: links in the middle of their play.
impl<K: Copy> Modify<K> for Gears {
    fn memory(&self) -> usize {
        MEMORY * self.joints
    }

    fn memory_owner(&self, place: usize) -> Owner {
        Owner::Joint(place / MEMORY)
    }

    /// Before the solver: replaces the motors' motion in `state` by that of the links, and hands the gears' torques to
    /// `drives`.
    #[inline(always)]
    fn engage<T: Real<K = K>>(
        &self,
        settings: &Settings,
        params: &Params<T>,
        state: &mut State<T>,
        memory: &[T],
        drives: &mut [Drive<T>],
    ) {
        let z = T::zero();
        let h = T::lit(settings.timestep);
        // Share of a step after which velocities act on the motor; below one half it would not be stable.
        let later = settings.emulated_step.map_or(1.0, |_| (settings.lead() / settings.timestep).max(0.5));
        for j in 0..self.joints {
            let p = &params.joints[j];
            let drive = &mut drives[j];
            let [offset, offset_rate, offset_acceleration] =
                [memory[MEMORY * j], memory[MEMORY * j + 1], memory[MEMORY * j + 2]];
            let (angle, velocity) = (state.qpos[j], state.qvel[j]);
            let link = velocity + offset_rate;
            let acceleration = state.qacc[j] + offset_acceleration;
            // The link's velocity at the end of the step, predicted.
            let ahead = h.fma(acceleration, link);
            // The motor: `impedance` times its velocity after the step is `effort`, with all torques but the gear's. The impedance
            // is its inertia over the step and what resists its velocity, N·m·s/rad.
            let torque = drive.torque;
            // At the torque limit the controller's torque does not depend on velocity, so its gain damps
            // nothing.
            let controlled = T::select_lt(torque.abs(), p.torque_limit, p.torque_scale * p.kd, z);
            let damping = p.damping + controlled + drive.resistance;
            // A rotor without inertia and damping would have no impedance, and an infinite mobility below.
            let impedance =
                T::lit(later).fma(damping, p.armature.max(T::lit(ROTOR)) * T::lit(1.0 / settings.timestep));
            let effort = impedance.fma(velocity, p.damping.fnma(velocity, torque));
            let friction = dry_friction(p, velocity, torque);
            // Where nothing touches. Dry friction takes all of an effort within its bound: the rotor stands still.
            let held = effort.clamp(-friction, friction);
            let free = (effort - held).div(impedance);
            // Motor less link after the step if nothing touched: its sign is that of the flank ahead.
            let twist = h.fma(free - ahead, -offset);
            let half = T::lit(0.5) * p.play;
            let side = T::select_lt(z, twist, half, -half);
            // On a flank: the gear's spring (N·m) and its impedance (`grip`, N·m·s/rad).
            let stiffness = p.compliance.max(T::lit(RIGID)).recip();
            let grip = stiffness * T::lit(settings.timestep + RETARDATION);
            // At the end of the step the gear's torque is `spring` + `grip` · (motor's velocity − link's).
            let spring = stiffness * (-offset - side);
            let sum = impedance + grip;
            let pushed = grip.fma(ahead, effort - spring);
            let rubbed = pushed.clamp(-friction, friction);
            // A rotor that friction holds gives the spring a fixed end.
            let slips = |slip, stick| T::select_lt(pushed.abs(), friction, stick, slip);
            // Motor and spring solved together: the motor's velocity drops out, and the torque is linear in the
            // link's.
            let share = grip.div(sum);
            let driven = effort - rubbed;
            let torque_slip = share.fma(driven, (T::lit(1.0) - share) * spring);
            let mobility = impedance.recip();
            // A twist within the play leaves the link free.
            let touching = |flank, gap| T::select_lt(half, twist.abs(), flank, gap);
            drive.gear = Some(Engaged {
                torque: touching(slips(torque_slip, spring), z),
                resistance: touching(slips(share * impedance, grip), z),
                rate: touching(slips(driven * mobility, z), free),
                mobility: touching(slips(mobility, z), z),
                motor: [angle, velocity],
            });
            state.qpos[j] = angle + offset;
            state.qvel[j] = link;
            state.qacc[j] = acceleration;
        }
    }

    /// After the step: moves the motors, and puts their motion in the place of the links'.
    #[inline(always)]
    fn release<T: Real<K = K>>(
        &self,
        settings: &Settings,
        _params: &Params<T>,
        state: &mut State<T>,
        memory: &mut [T],
        drives: &mut [Drive<T>],
    ) {
        let h = T::lit(settings.timestep);
        for j in 0..self.joints {
            let Some(gear) = drives[j].gear.take() else { continue };
            // τ = α − β v', with the link's velocity after the step.
            let torque = gear.resistance.fnma(state.qvel[j], gear.torque);
            let velocity = gear.mobility.fnma(torque, gear.rate);
            // Mean over the step: the next step's prediction of the link's velocity adds the offset from it.
            let acceleration = (velocity - gear.motor[1]) * T::lit(1.0 / settings.timestep);
            let angle = h.fma(velocity, gear.motor[0]);
            memory[MEMORY * j] = state.qpos[j] - angle;
            memory[MEMORY * j + 1] = state.qvel[j] - velocity;
            memory[MEMORY * j + 2] = state.qacc[j] - acceleration;
            // Outside of the step the state is that of the motors.
            state.qpos[j] = angle;
            state.qvel[j] = velocity;
            state.qacc[j] = acceleration;
        }
    }
}
