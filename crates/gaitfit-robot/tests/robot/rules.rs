//! Every rule of the guard, provoked.

use std::time::Duration;

use gaitfit_robot::guard::Reason;
use gaitfit_robot::unitree::{CommandMessage, LowCmd};
use gaitfit_robot::{Battery, PerMotor, Phase, Reading, RobotError, Seal, damping};

use crate::limits::violation;
use crate::toy::{Run, STANDING, go2, postures};

const DAMPING_KD: f32 = 2.0;

fn march(now: Duration) -> Option<PerMotor<f32>> {
    crate::toy::march(&go2(), now)
}

/// A walking run that hears one changed message; the reason it gives.
fn after(change: impl Fn(&mut Reading)) -> Reason {
    let mut run = Run::armed();
    run.until(Phase::Walk);
    run.for_ms(500);
    run.tick_with(
        |mut reading| {
            change(&mut reading);
            Some(reading)
        },
        march,
    );
    is_damped(&run);
    run.supervisor.reason().unwrap().clone()
}

/// The run is in damping and its command holds nothing.
fn is_damped(run: &Run) {
    assert_eq!(run.supervisor.phase(), Phase::Damping);
    for motor in &run.command.unwrap() {
        assert!(motor.kp == 0.0 && motor.tau == 0.0 && motor.kd > 0.0 && motor.kd <= DAMPING_KD, "{motor:?}");
    }
}

#[test]
fn an_undisturbed_run_stands_up_walks_lies_down_and_ends() {
    let mut run = Run::new();
    run.for_ms(100);
    assert_eq!(
        (run.supervisor.phase(), run.command),
        (Phase::Idle, None),
        "nothing is sent before it is armed"
    );
    run.supervisor.arm(run.now).unwrap();
    let mut phases = Vec::new();
    while !run.supervisor.is_over(run.now) {
        run.tick();
        if phases.last() != Some(&run.supervisor.phase()) {
            phases.push(run.supervisor.phase());
        }
        assert_eq!(violation(&run.command.unwrap(), &run.toy.state), None);
        if run.supervisor.phase() == Phase::Stand {
            assert!(run.toy.state.q.iter().zip(&STANDING).all(|(q, wanted)| (q - wanted).abs() < 0.05));
        }
        if run.now > Duration::from_secs(8) {
            run.supervisor.lie_down(run.now);
        }
    }
    use Phase::{Damping, LieDown, Stand, StandUp, Walk};
    assert_eq!(phases, [StandUp, Stand, Walk, LieDown, Damping]);
    assert_eq!(run.supervisor.reason(), None);
    is_damped(&run);
}

#[test]
fn a_command_goes_out_with_head_mode_and_checksum() {
    let mut run = Run::armed();
    run.until(Phase::Walk);
    let message = LowCmd::for_motors(&run.command.unwrap(), &go2().slots(), 0);
    assert_eq!((message.head, message.level_flag, message.crc), ([0xFE, 0xEF], 0xFF, message.checksum()));
    assert!(message.motor_cmd[..12].iter().all(|motor| motor.mode == 1 && motor.kp > 0.0));
    assert!(message.motor_cmd[12..].iter().all(|motor| motor.mode == 0 && motor.kp == 0.0));
}

#[test]
fn without_a_state_it_is_not_armed() {
    let mut run = Run::new();
    assert_eq!(run.supervisor.arm(run.now), Err(RobotError::NotArmed(Reason::NoState)));
    assert_eq!(run.supervisor.tick(run.now), None);
}

#[test]
fn a_second_controller_keeps_it_from_being_armed_and_stops_a_walk() {
    let mut run = Run::new();
    run.supervisor.second_controller(run.now);
    run.for_ms(100);
    assert_eq!(run.supervisor.arm(run.now), Err(RobotError::NotArmed(Reason::SecondController)));

    let mut run = Run::armed();
    run.until(Phase::Walk);
    run.supervisor.second_controller(run.now);
    run.tick();
    is_damped(&run);
    assert!(run.supervisor.reason().unwrap().to_string().contains("ReleaseMode"));
}

#[test]
fn what_is_mended_while_idle_does_not_keep_it_from_being_armed() {
    let mut run = Run::new();
    run.toy.state.temperature[4] = 95;
    run.tick();
    assert_eq!(
        run.supervisor.arm(run.now),
        Err(RobotError::NotArmed(Reason::Hot { joint: "FL_thigh".to_owned(), degrees: 95 }))
    );
    run.toy.state.temperature[4] = 40;
    run.tick();
    run.supervisor.arm(run.now).unwrap();
}

#[test]
fn a_lost_state_stops_after_20_ms_and_not_before() {
    let mut run = Run::armed();
    run.until(Phase::Walk);
    for lost in 1..=11 {
        run.tick_with(|_| None, march);
        let stale = run.supervisor.phase() == Phase::Damping;
        assert_eq!(stale, lost > 10, "{lost} messages of 2 ms");
    }
    assert_eq!(run.supervisor.reason(), Some(&Reason::StaleState(22.0)));
    is_damped(&run);
}

#[test]
fn a_state_whose_counter_stands_still_is_none() {
    let mut run = Run::armed();
    run.until(Phase::Walk);
    let frozen = run.toy.reading();
    (0..12).for_each(|_| run.tick_with(|_| Some(frozen), march));
    assert!(matches!(run.supervisor.reason(), Some(Reason::StaleState(_))));
}

#[test]
fn a_wrong_checksum_stops() {
    assert_eq!(after(|reading| reading.seal = Seal::Wrong), Reason::WrongChecksum);
    assert_eq!(after(|reading| reading.seal = Seal::Absent), Reason::WrongChecksum);
}

#[test]
fn numbers_that_are_not_finite_stop() {
    let reason = after(|reading| reading.state.q[5] = f32::NAN);
    assert_eq!(reason, Reason::StateNotFinite("a joint's angle"));
    let reason = after(|reading| reading.state.dq[0] = f32::INFINITY);
    assert_eq!(reason, Reason::StateNotFinite("a joint's velocity"));
    let reason = after(|reading| reading.state.torque[11] = f32::NAN);
    assert_eq!(reason, Reason::StateNotFinite("a joint's torque"));
    let reason = after(|reading| reading.state.quaternion[2] = f32::NAN);
    assert_eq!(reason, Reason::StateNotFinite("the orientation"));
    let reason = after(|reading| reading.state.gyroscope[0] = f32::NEG_INFINITY);
    assert_eq!(reason, Reason::StateNotFinite("the gyroscope"));
    let reason = after(|reading| reading.state.accelerometer[1] = f32::NAN);
    assert_eq!(reason, Reason::StateNotFinite("the accelerometer"));
}

#[test]
fn joints_out_of_range_too_fast_or_jumping_stop() {
    let reason = after(|reading| reading.state.q[2] = -0.6);
    assert_eq!(reason, Reason::OutOfRange { joint: "FR_calf".to_owned(), angle: -0.6 });
    let reason = after(|reading| reading.state.dq[7] = 50.0);
    assert_eq!(reason, Reason::TooFast { joint: "RR_thigh".to_owned(), speed: 50.0 });
    let reason = after(|reading| reading.state.q[1] += 0.5);
    assert!(matches!(&reason, Reason::Jump { joint, .. } if joint == "FR_thigh"), "{reason:?}");

    // Messages that were held up come in a heap: by the robot's counter they are further apart.
    let mut run = Run::armed();
    run.until(Phase::Walk);
    let far = |ticks: u32| {
        move |mut reading: Reading| {
            reading.state.q[1] += 0.5;
            reading.state.tick += ticks;
            Some(reading)
        }
    };
    run.tick_with(far(18), march);
    assert_eq!(run.supervisor.reason(), None);
    let mut run = Run::armed();
    run.until(Phase::Walk);
    run.tick_with(far(0), march);
    assert!(matches!(run.supervisor.reason(), Some(Reason::Jump { joint, .. }) if joint == "FR_thigh"));
}

#[test]
fn joints_in_another_order_stop() {
    // All hips, then thighs, then calves: a common order.
    let reason = after(|reading| {
        let q = reading.state.q;
        reading.state.q = PerMotor::from_fn(12, |k| q[3 * (k % 4) + k / 4]);
    });
    assert!(matches!(reason, Reason::OutOfRange { .. }), "{reason:?}");
    assert!(reason.to_string().contains("another order"));
}

#[test]
fn tilt_heat_and_an_empty_battery_stop() {
    let tilted = |degrees: f32| {
        let (sin, cos) = (degrees.to_radians() / 2.0).sin_cos();
        move |reading: &mut Reading| reading.state.quaternion = [cos, 0.0, sin, 0.0]
    };
    assert!(matches!(after(tilted(61.0)), Reason::Tilt(degrees) if (degrees - 61.0).abs() < 0.1));
    assert_eq!(after(|reading| reading.state.quaternion = [0.0; 4]), Reason::NoOrientation);
    let reason = after(|reading| reading.state.temperature[8] = 81);
    assert_eq!(reason, Reason::Hot { joint: "RR_calf".to_owned(), degrees: 81 });
    let battery = |charge| {
        move |reading: &mut Reading| {
            reading.state.battery = Some(Battery { charge, volts: 25.0, amps: 3.0 });
        }
    };
    assert_eq!(after(battery(14)), Reason::Battery(14));
    assert_eq!(after(|reading| reading.state.battery = None), Reason::NoBattery);

    let mut run = Run::armed();
    run.until(Phase::Walk);
    for change in [tilted(59.0), tilted(-59.0)] {
        run.tick_with(
            |mut reading| {
                change(&mut reading);
                Some(reading)
            },
            march,
        );
    }
    run.tick_with(
        |mut reading| {
            battery(15)(&mut reading);
            Some(reading)
        },
        march,
    );
    assert_eq!(run.supervisor.phase(), Phase::Walk, "{:?}", run.supervisor.reason());
}

#[test]
fn a_policy_that_is_not_finite_or_late_stops() {
    let mut run = Run::armed();
    run.until(Phase::Walk);
    let mut bad = PerMotor::from(STANDING);
    bad[6] = f32::NAN;
    (0..10).for_each(|_| run.tick_with(Some, |_| Some(bad)));
    assert_eq!(run.supervisor.reason(), Some(&Reason::PolicyNotFinite));
    is_damped(&run);

    let mut run = Run::armed();
    run.until(Phase::Walk);
    (0..40).for_each(|_| run.tick_with(Some, |_| None));
    assert!(matches!(run.supervisor.reason(), Some(Reason::LatePolicy(ms)) if *ms > 50.0 && *ms < 54.0));
}

#[test]
fn a_policys_wild_output_stays_inside_the_limits() {
    let mut run = Run::armed();
    run.until(Phase::Walk);
    for step in 0..250 {
        let sign = if step % 20 < 10 { 1.0 } else { -1.0 };
        run.tick_with(Some, |_| Some(PerMotor::new(12, sign * 1e20)));
        assert_eq!(violation(&run.command.unwrap(), &run.toy.state), None);
    }
}

#[test]
fn a_late_loop_stops() {
    let mut run = Run::armed();
    run.until(Phase::Walk);
    // The state is fresh, the loop slept.
    run.now += Duration::from_millis(25);
    run.tick();
    assert!(matches!(run.supervisor.reason(), Some(Reason::LateLoop(ms)) if *ms > 26.0 && *ms < 28.0));
    is_damped(&run);
}

#[test]
fn operator_signal_terminal_and_link_stop_and_the_first_reason_stays() {
    for reason in [Reason::Operator, Reason::Signal, Reason::TerminalLost, Reason::Link("gone".to_owned())] {
        for phase in [Phase::StandUp, Phase::Stand, Phase::Walk] {
            let mut run = Run::armed();
            run.until(phase);
            run.supervisor.stop(run.now, reason.clone());
            run.supervisor.stop(run.now, Reason::Operator);
            run.supervisor.lie_down(run.now);
            run.tick();
            is_damped(&run);
            assert_eq!(run.supervisor.reason(), Some(&reason));
        }
    }
}

#[test]
fn damping_is_never_left() {
    let mut run = Run::armed();
    run.until(Phase::Walk);
    run.supervisor.stop(run.now, Reason::Operator);
    for _ in 0..2000 {
        run.tick();
        is_damped(&run);
        run.supervisor.lie_down(run.now);
        let _ = run.supervisor.arm(run.now);
    }
    assert!(run.supervisor.is_over(run.now));
    let slow = run.toy.state.dq.iter().all(|dq| dq.abs() < 1e-3);
    assert!(slow, "{:?} {:?}", run.toy.state.dq, damping(&PerMotor::new(12, 2.0))[0]);
}

#[test]
fn a_simulators_message_without_checksum_counter_and_battery_is_taken_from_simulators_only() {
    use gaitfit_robot::Supervisor;
    use gaitfit_robot::guard::GuardSettings;
    let mut run = Run::new();
    let settings = GuardSettings { simulator: true, ..GuardSettings::new(&go2(), crate::toy::CONTROL) };
    let mut simulated = Supervisor::new(settings, postures(&go2()), gaitfit_robot::Times::default());
    let mut bare = run.toy.reading();
    (bare.seal, bare.state.tick, bare.state.battery) = (Seal::Absent, 0, None);
    simulated.read(Duration::ZERO, &bare);
    simulated.read(Duration::from_millis(15), &bare);
    simulated.arm(Duration::from_millis(30)).unwrap();
    run.supervisor.read(Duration::ZERO, &bare);
    assert!(run.supervisor.arm(Duration::ZERO).is_err());
    // Nothing but torque limits a simulator's motors.
    bare.state.dq[2] = 30.0;
    simulated.read(Duration::from_millis(31), &bare);
    assert_eq!(simulated.reason(), None);
    bare.seal = Seal::Wrong;
    simulated.read(Duration::from_millis(32), &bare);
    assert_eq!(simulated.reason(), Some(&Reason::WrongChecksum));
}

#[test]
fn a_robot_that_comes_to_rest_is_guarded_as_one_that_walks_and_lies_down_from_there() {
    let mut run = Run::armed();
    run.supervisor.slow_down(run.now);
    assert_eq!(run.supervisor.phase(), Phase::StandUp, "it does not walk yet");
    run.until(Phase::Walk);
    run.supervisor.slow_down(run.now);
    run.for_ms(400);
    assert_eq!((run.supervisor.phase(), run.supervisor.reason()), (Phase::Stop, None));
    let mut late = Run { supervisor: run.supervisor.clone(), toy: run.toy.clone(), robot: go2(), ..run };
    for _ in 0..100 {
        late.tick_with(Some, |_| None);
    }
    assert!(
        matches!(late.supervisor.reason(), Some(Reason::LatePolicy(_))),
        "{:?}",
        late.supervisor.reason()
    );
    run.supervisor.lie_down(run.now);
    assert_eq!(run.supervisor.phase(), Phase::LieDown);
    run.until(Phase::Damping);
    assert_eq!(run.supervisor.reason(), None);
}
