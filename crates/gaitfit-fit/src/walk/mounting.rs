//! How an inertial unit is mounted, as the policy shows it: its actions follow from the logs only if gravity and rates are
//! turned into the base's frame.
//!
//! Gravity alone shows an upside-down unit, not about which axis it was turned, and nothing of one that is turned about the
//! vertical. Of the 24 turns by right angles one makes the logged actions the policy's.

use super::recorded::Read;
use super::{policy_check, rate, reference};
use gaitfit_log::{ImuSettings, Trajectory};
use gaitfit_policy::Policy;

/// The actions are the policy's below this mismatch (as in `policy_check`), and only if other turns have so many
/// times as much.
const AGREES: f64 = 0.08;
const CLEARLY: f64 = 2.5;

/// Roll, pitch and yaw, degrees, of all turns by right angles but none.
fn turns() -> impl Iterator<Item = [f64; 3]> {
    // The 24 rotations of a cube: four turns about the vertical of each of the six sides that can be up.
    let angles = [0.0, 90.0, 180.0, -90.0];
    let rolled = angles.into_iter().flat_map(move |yaw| angles.map(|roll| [roll, 0.0, yaw]));
    let pitched = angles.into_iter().flat_map(|yaw| [[0.0, 90.0, yaw], [0.0, -90.0, yaw]]);
    rolled.chain(pitched).filter(|turn| *turn != [0.0; 3])
}

/// Turns the inertial units of all logs, where the policy leaves no doubt of how they are mounted, and tells so.
pub fn settle(reads: &mut [Read], policy: &Policy) -> Option<String> {
    let control = |read: &Read| -> Option<Trajectory> {
        let base = read.trajectory.base.as_ref()?;
        (base.quaternion.is_some() && base.angular_velocity.is_some())
            .then(|| rate::to_control(&read.trajectory, policy.interface.control_dt).ok())
            .flatten()
            .map(|regular| regular.trajectory)
    };
    // All logs or none: one mounting is looked for that explains them all.
    let logs: Vec<Trajectory> = reads.iter().map(control).collect::<Option<_>>()?;
    let turned = |mounting: [f64; 3]| -> Option<f64> {
        let settings = ImuSettings { mounting: Some(mounting), ..ImuSettings::default() };
        let mut logs = logs.clone();
        logs.iter_mut().for_each(|log| turn(log, policy, &settings));
        policy_check::mismatch(policy, &logs.iter().collect::<Vec<_>>())
    };
    // Actions that follow already show that the unit is mounted as stated.
    // Too few samples for a comparison end the search here with `?`.
    let here = policy_check::mismatch(policy, &logs.iter().collect::<Vec<_>>())?;
    if here < AGREES {
        return None;
    }
    let mut ranked: Vec<([f64; 3], f64)> = turns().filter_map(|turn| Some((turn, turned(turn)?))).collect();
    ranked.sort_by(|a, b| a.1.total_cmp(&b.1));
    let (&(mounting, best), &(_, second)) = (ranked.first()?, ranked.get(1)?);
    // The turn must fit well, much better than none, and much better than the second.
    if best > AGREES || here < CLEARLY * best || second < CLEARLY * best {
        return None;
    }
    let settings = ImuSettings { mounting: Some(mounting), ..ImuSettings::default() };
    for read in reads {
        turn(&mut read.trajectory, policy, &settings);
        read.mounting = Some(mounting);
    }
    let [roll, pitch, yaw] = mounting;
    Some(format!(
        "the inertial unit is mounted turned: the logged actions follow from the policy with mounting = [{roll}, {pitch}, {yaw}] \
         (difference {best:.3} of their spread, and {here:.3} without), so orientation and rates were turned. State it in the \
         table [imu] of log.toml"
    ))
}

/// Turns the inertial unit of a log, and with it the motion whose heading it showed.
fn turn(log: &mut Trajectory, policy: &Policy, settings: &ImuSettings) {
    reference::turn_unit(log, &policy.interface, |log| {
        if let Some(base) = &mut log.base {
            settings.apply(base);
        }
    });
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::walk::fixtures::{logs, policy, scene};
    use crate::walk::log_files::LogFile;
    use gaitfit_model::rotation::{from_rpy, product, quat_of, rotate_back, vec_of};

    #[test]
    fn the_policy_shows_how_the_unit_is_mounted() {
        assert_eq!(turns().count(), 23);
        let scene = scene();
        let policy = policy(&scene, 3);
        let right = logs(&scene, &policy, true);
        let read = |trajectory: Trajectory| {
            let file = LogFile { name: "a.csv".into(), path: "a.csv".into() };
            Read::new(file, trajectory)
        };
        let mut reads: Vec<Read> = right.iter().cloned().map(read).collect();
        assert_eq!(settle(&mut reads, &policy), None);
        let mounted = from_rpy(std::f64::consts::PI, 0.0, std::f64::consts::FRAC_PI_2);
        for read in &mut reads {
            let base = read.trajectory.base.as_mut().unwrap();
            for q in base.quaternion.as_mut().unwrap().chunks_exact_mut(4) {
                q.copy_from_slice(&product(quat_of(q), mounted));
            }
            for w in base.angular_velocity.as_mut().unwrap().chunks_exact_mut(3) {
                w.copy_from_slice(&rotate_back(mounted, vec_of(w)));
            }
        }
        let text = settle(&mut reads, &policy).unwrap();
        assert!(text.contains("[180, 0, 90]"), "{text}");
        assert!(reads.iter().all(|read| read.mounting == Some([180.0, 0.0, 90.0])));
        for (read, right) in reads.iter().zip(&right) {
            let rates = |log: &Trajectory| log.base.as_ref().unwrap().angular_velocity.clone().unwrap();
            let off = rates(&read.trajectory)
                .iter()
                .zip(rates(right))
                .map(|(a, b)| (a - b).abs())
                .fold(0.0, f64::max);
            assert!(off < 1e-9, "{off}");
        }
    }
}
