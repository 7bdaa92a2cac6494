//! The place of a log in the motion that its policy follows: cells that cannot be, and times that do not run.

/// No heading is further from 0 than two turns, rad: in degrees it is.
const MAX_HEADING: f64 = 4.0 * std::f64::consts::PI;
/// No motion is longer, s; in milliseconds it is.
const MAX_TIME: f64 = 1e6;
/// Relative error of the speed at which `motion_time` runs.
const SPEED_ERROR: f64 = 0.02;

/// The first of (time, heading) that is no place in a motion, and why.
pub(crate) fn place(place: &[f64]) -> Option<(usize, &'static str)> {
    if let Some(at) = place.iter().position(|value| !value.is_finite()) {
        return Some((
            at,
            "no place in a motion, which must be known at every sample; delete the row, or leave out both columns of a log that \
             begins with the motion",
        ));
    }
    match place {
        [time, _] if time.abs() > MAX_TIME => {
            Some((0, "no time in a motion; give seconds since its beginning"))
        }
        [_, heading] if heading.abs() > MAX_HEADING => Some((1, "more than two turns; give radians")),
        _ => None,
    }
}

/// What is wrong with the times in a motion (`rows × 2`: time, heading) of a log with these times, s, in words. They must run as
/// the log's do; in a log of several episodes they begin again.
pub(crate) fn runs_wrongly(time: &[f64], motion: &[f64]) -> Option<String> {
    let mut speeds: Vec<f64> = (1..time.len().min(motion.len() / 2))
        .map(|row| (motion[2 * row] - motion[2 * row - 2]) / (time[row] - time[row - 1]))
        // Rows of one time have an infinite speed.
        .filter(|speed| speed.is_finite())
        .collect();
    let speed = crate::stats::median(&mut speeds)?;
    let what = match speed {
        _ if (speed - 1.0).abs() <= SPEED_ERROR => return None,
        0.0 => "stands still".to_owned(),
        _ if speed < 0.0 => "runs backwards".to_owned(),
        _ => format!("runs {} times as fast as `time`", gaitfit_model::significant(speed, 4)),
    };
    Some(format!(
        "motion_time {what}; give the seconds since the motion's beginning at every sample, or leave out motion_time and \
         motion_heading of a log that begins with the motion"
    ))
}

/// The places in a motion between samples: for each a sample and the fraction of the way to the next. The motion runs on from the
/// sample before. Where an episode ends between two samples, the place belongs to the nearer one; headings are those of a sample,
/// as they do not change within an episode.
pub(crate) fn at(time: &[f64], motion: &[f64], places: &[(usize, f64)]) -> Vec<f64> {
    let place = |&(row, fraction): &(usize, f64)| -> [f64; 2] {
        let here = [motion[2 * row], motion[2 * row + 1]];
        if fraction == 0.0 {
            return here;
        }
        let (next, step) = ([motion[2 * row + 2], motion[2 * row + 3]], time[row + 1] - time[row]);
        // Places that were lost between two rows of one episode: the motion's time and the clock's agree.
        if (next[0] - here[0] - step).abs() <= 0.5 * step.abs() {
            return [here[0] + fraction * (next[0] - here[0]), here[1]];
        }
        if fraction < 0.5 {
            [here[0] + fraction * step, here[1]]
        } else {
            [next[0] - (1.0 - fraction) * step, next[1]]
        }
    };
    places.iter().flat_map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_samples_a_motion_runs_on_and_never_through_a_restart() {
        let time = [0.0, 0.02, 0.04, 0.06];
        // A restart after the second row, with a heading on the other side of ±π.
        let motion = [5.0, 3.1, 5.02, 3.1, 0.0, -3.1, 0.02, -3.1];
        let poses = at(&time, &motion, &[(0, 0.5), (1, 0.0), (1, 0.25), (1, 0.75), (2, 0.5)]);
        let wanted = [5.01, 3.1, 5.02, 3.1, 5.025, 3.1, -0.005, -3.1, 0.01, -3.1];
        for (value, wanted) in poses.iter().zip(wanted) {
            assert!((value - wanted).abs() < 1e-12, "{value} {wanted}");
        }
    }

    #[test]
    fn places_in_a_motion_are_seconds_and_radians() {
        assert_eq!(place(&[12.5, -3.0]), None);
        for (bad, at) in
            [([f64::NAN, 0.0], 0), ([0.0, f64::INFINITY], 1), ([1e300, 0.0], 0), ([0.0, 40.0], 1)]
        {
            assert_eq!(place(&bad).map(|(at, _)| at), Some(at), "{bad:?}");
        }
    }

    #[test]
    fn times_in_a_motion_run_as_the_clock_does() {
        let time: Vec<f64> = (0..100).map(|row| 0.02 * f64::from(row)).collect();
        let motion = |place: &dyn Fn(f64) -> f64| -> Vec<f64> {
            time.iter().flat_map(|&time| [place(time), 0.5]).collect()
        };
        assert_eq!(runs_wrongly(&time, &motion(&|t| t + 3.0)), None);
        // A second episode.
        assert_eq!(runs_wrongly(&time, &motion(&|t| t % 1.0)), None);
        for (place, word) in [
            (&(|t| 1e3 * t) as &dyn Fn(f64) -> f64, "runs 1000 times"),
            (&|_| 2.0, "stands still"),
            (&|t| 5.0 - t, "runs backwards"),
        ] {
            let remark = runs_wrongly(&time, &motion(place));
            assert!(remark.as_ref().is_some_and(|text| text.contains(word)), "{remark:?}");
        }
    }
}
