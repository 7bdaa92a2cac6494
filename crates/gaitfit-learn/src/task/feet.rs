//! Clocks of the feet: how long each has been on the ground or off it.

use super::expression::flag;
use gaitfit_physics::Real;
use gaitfit_policy::walker::TOUCH;

/// A foot at one moment.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Foot {
    /// Whether it is on the ground.
    pub touching: bool,
    /// Whether it came down in this step.
    pub landed: bool,
    /// Time since it left the ground, s; 0 on the ground.
    pub air: f32,
    /// Time since it met the ground, s; 0 in the air.
    pub contact: f32,
    /// Length of its last flight, s.
    pub last_air: f32,
    /// Place of its centre, m, world frame.
    pub place: [f32; 3],
    /// Height of its centre above the ground under it, m.
    pub height: f32,
    /// Horizontal speed over the last control period, m/s.
    pub speed: f32,
}

/// A foot's numbers ([`Foot::NAMES`]) after a control period, and 1 if the foot came down in this period, else 0.
/// `force`: on it, N; `place`: of its centre, m, world frame; `dt`: the period, s; `begins`: 1 in an episode's first
/// period, before which there was no place to move from, else 0. Kernels are written from this.
pub fn advanced<R: Real>(
    [touching, air, contact, last_air, x, y, _, _]: [R; Foot::NUMBERS],
    force: R,
    place: [R; 3],
    dt: R,
    begins: R,
) -> ([R; Foot::NUMBERS], R) {
    let (zero, one) = (R::zero(), R::lit(1.0));
    // Numbers 0 and 1 in place of conditions: the same text runs on lanes and is recorded for kernels.
    let touches = R::select_lt(R::lit(TOUCH.into()), force, one, zero);
    // `on` if the foot touches the ground, else `off`.
    let either = |on, off| R::select_lt(zero, touches, on, off);
    // A foot that stands when its episode begins has not flown, so its first contact is no landing.
    let flew = R::select_lt(zero, air, one, zero);
    let landed = touches * (one - touching) * flew;
    // A flight's length is taken when it ends, and kept until the next one ends.
    let last_air = either(R::select_lt(zero, air, air, last_air), last_air);
    let (dx, dy) = (place[0] - x, place[1] - y);
    let speed = (dx * dx + dy * dy).sqrt().div(dt);
    let speed = R::select_lt(zero, begins, zero, speed);
    let [x, y, z] = place;
    ([touches, either(zero, air + dt), either(contact + dt, zero), last_air, x, y, z, speed], landed)
}

impl Foot {
    /// Count of the numbers that it keeps from step to step.
    pub const NUMBERS: usize = 8;
    /// Their names, in the order of [`Foot::numbers`].
    pub const NAMES: [&'static str; Self::NUMBERS] =
        ["touching", "air", "contact", "last_air", "place_x", "place_y", "place_z", "speed"];

    /// Updates the foot at the end of a control period of `dt` seconds. `ground`: height of the ground under it, m; `begins`:
    /// whether it is the episode's first.
    pub fn advance(&mut self, force: f32, place: [f32; 3], ground: f32, dt: f32, begins: bool) {
        let (numbers, landed) = advanced(self.numbers(), force, place, dt, flag(begins));
        *self = Self { landed: landed != 0.0, height: place[2] - ground, ..Self::from_numbers(&numbers) };
    }

    /// Its numbers, for a checkpoint.
    pub fn numbers(&self) -> [f32; Self::NUMBERS] {
        let [x, y, z] = self.place;
        [flag(self.touching), self.air, self.contact, self.last_air, x, y, z, self.speed]
    }

    /// The foot of these numbers, as high as on flat ground.
    pub fn from_numbers(n: &[f32; Self::NUMBERS]) -> Self {
        Self {
            touching: n[0] != 0.0,
            landed: false,
            air: n[1],
            contact: n[2],
            last_air: n[3],
            place: [n[4], n[5], n[6]],
            height: n[6],
            speed: n[7],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_timed() {
        let mut foot = Foot::default();
        let forces = [50.0, 50.0, 0.0, 0.0, 0.0, 50.0];
        let mut landed = Vec::new();
        for (k, force) in forces.into_iter().enumerate() {
            foot.advance(force, [0.01 * k as f32, 0.0, 0.02], -0.03, 0.02, k == 0);
            assert_eq!(
                Foot { landed: foot.landed, height: foot.height, ..Foot::from_numbers(&foot.numbers()) },
                foot
            );
            landed.push(foot.landed);
        }
        assert_eq!(landed, [false, false, false, false, false, true]);
        assert!((foot.last_air - 0.06).abs() < 1e-6 && foot.air == 0.0);
        assert!((foot.contact - 0.02).abs() < 1e-6);
        assert!((foot.speed - 0.5).abs() < 1e-5);
        assert!((foot.height - 0.05).abs() < 1e-7 && foot.place[2] == 0.02);
    }
}
