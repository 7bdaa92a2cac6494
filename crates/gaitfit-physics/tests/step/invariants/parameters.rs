//! The table of joint parameters.

use gaitfit_physics::{JointParameter, SearchDefaults};

#[test]
fn rows_make_sense() {
    for &parameter in JointParameter::ALL {
        let name = parameter.name();
        assert_eq!(JointParameter::ALL.iter().filter(|other| other.name() == name).count(), 1, "{name}");
        // Those that `Robot::params` has words for.
        assert!([f64::NEG_INFINITY, 0.0, 1e-3].contains(&parameter.least()), "{name}");
        if let Some(SearchDefaults { lower, upper, start, deviation }) = parameter.search() {
            assert!(parameter.least() <= lower && lower <= start && start <= upper, "{name}");
            assert!(lower < upper && deviation > 0.0, "{name}");
        }
    }
    assert_eq!(JointParameter::searched().count(), 22);
}
