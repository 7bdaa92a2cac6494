//! Clocks of the feet: how long each has been on the ground or off it.

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

impl Foot {
    /// Takes up the end of a control period of `dt` seconds; `ground`: height of the ground under the foot, m.
    pub fn advance(&mut self, force: f32, place: [f32; 3], ground: f32, dt: f32) {
        let touching = force > TOUCH;
        self.landed = touching && !self.touching && self.air > 0.0;
        if touching {
            if self.air > 0.0 {
                self.last_air = self.air;
            }
            self.air = 0.0;
            self.contact += dt;
        } else {
            self.contact = 0.0;
            self.air += dt;
        }
        self.touching = touching;
        let (dx, dy) = (place[0] - self.place[0], place[1] - self.place[1]);
        self.speed = (dx * dx + dy * dy).sqrt() / dt;
        self.place = place;
        self.height = place[2] - ground;
    }

    /// Its numbers, for a checkpoint.
    pub fn numbers(&self) -> [f32; 8] {
        let flag = |on: bool| if on { 1.0 } else { 0.0 };
        let [x, y, z] = self.place;
        [flag(self.touching), self.air, self.contact, self.last_air, x, y, z, self.speed]
    }

    /// The foot of these numbers, as high as on flat ground.
    pub fn from_numbers(n: &[f32; 8]) -> Self {
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
            foot.advance(force, [0.01 * k as f32, 0.0, 0.02], -0.03, 0.02);
            landed.push(foot.landed);
        }
        assert_eq!(landed, [false, false, false, false, false, true]);
        assert!((foot.last_air - 0.06).abs() < 1e-6 && foot.air == 0.0);
        assert!((foot.contact - 0.02).abs() < 1e-6);
        assert!((foot.speed - 0.5).abs() < 1e-5);
        assert!((foot.height - 0.05).abs() < 1e-7 && foot.place[2] == 0.02);
    }
}
