//! Errors of a robot's sensors, apart from noise.
//!
//! Sensors are outside the physics: their errors change what a policy observes and what a log shows, but not the motion.

use gaitfit_model::rotation::{add, axes, dot, from_rpy, inverse, product, sub};

use crate::Start;

/// Errors of the sensors of one robot. The default has none.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Sensors {
    /// Roll and pitch of the inertial unit's mounting error, rad: the unit's frame is the base's frame turned by
    /// Ry(pitch)·Rx(roll).
    pub imu_tilt: [f64; 2],
    /// Reading of the gyro at rest, rad/s, axes of the unit.
    pub gyro_bias: [f64; 3],
}

impl Sensors {
    /// The inertial unit; `None` if it has no errors.
    pub fn imu(&self) -> Option<Imu> {
        (self.imu_tilt != [0.0; 2] || self.gyro_bias != [0.0; 3]).then(|| Imu::new(self))
    }
}

/// An inertial unit with errors. With R, the unit's orientation in the base, and g and ω in the base's frame, it reads
/// gravity as Rᵀ g and rates as Rᵀ ω + bias.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Imu {
    /// R as a quaternion, wxyz, unit.
    turn: [f32; 4],
    /// The columns of R: the unit's axes in the base's frame.
    axes: [[f32; 3]; 3],
    /// rad/s, axes of the unit.
    bias: [f32; 3],
}

/// Count of [`Imu::numbers`].
pub const IMU_NUMBERS: usize = 17;

impl Imu {
    fn new(sensors: &Sensors) -> Self {
        let [roll, pitch] = sensors.imu_tilt;
        let turn = from_rpy(roll, pitch, 0.0);
        Self {
            turn: turn.map(|x| x as f32),
            axes: axes(turn).map(|axis| axis.map(|x| x as f32)),
            bias: sensors.gyro_bias.map(|x| x as f32),
        }
    }

    /// A direction of the base's frame in the unit's.
    pub fn direction(&self, v: [f32; 3]) -> [f32; 3] {
        self.axes.map(|axis| dot(axis, v))
    }

    /// Reading of the gyro, rad/s, for angular velocity `rates` of the base (rad/s, body frame).
    pub fn rates(&self, rates: [f32; 3]) -> [f32; 3] {
        add(self.direction(rates), self.bias)
    }

    /// The orientation of the unit, wxyz, of a base with orientation `base`.
    pub fn attitude(&self, base: [f32; 4]) -> [f32; 4] {
        product(base, self.turn)
    }

    /// Orientation and angular velocity (rad/s, body frame) of the base of which the unit reads these: the inverse of
    /// [`Imu::attitude`] and [`Imu::rates`].
    pub fn base(&self, attitude: [f32; 4], rates: [f32; 3]) -> ([f32; 4], [f32; 3]) {
        // The bias is in the axes of the unit, so it is taken away before the turn.
        let unbiased = sub(rates, self.bias);
        let [x, y, z] = self.axes;
        // The axes are the columns of R, so this is R times the rates.
        let rates = std::array::from_fn(|k| x[k] * unbiased[0] + y[k] * unbiased[1] + z[k] * unbiased[2]);
        (product(attitude, inverse(self.turn)), rates)
    }

    /// The state of a robot whose sensors read `reading`.
    pub fn state(&self, reading: &Start) -> Start {
        let (base_quaternion, base_angular) = self.base(reading.base_quaternion, reading.base_angular);
        Start { base_quaternion, base_angular, ..reading.clone() }
    }

    /// All of it for kernels, [`IMU_NUMBERS`] numbers: 1, `turn`, the three `axes`, `bias`. A robot whose unit has no
    /// errors has 0 there first.
    pub fn numbers(imu: Option<&Self>) -> [f32; IMU_NUMBERS] {
        // 1 + 4 + 9 + 3 numbers; without errors all of them stay 0.
        let mut numbers = [0.0; IMU_NUMBERS];
        if let Some(Self { turn, axes, bias }) = imu {
            let errors = turn.iter().chain(axes.iter().flatten()).chain(bias);
            numbers
                .iter_mut()
                .zip(std::iter::once(&1.0).chain(errors))
                .for_each(|(to, &number)| *to = number);
        }
        numbers
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_model::rotation::up;

    fn unit() -> Sensors {
        Sensors { imu_tilt: [0.03, -0.05], gyro_bias: [0.02, -0.01, 0.005] }
    }

    fn near<const N: usize>(found: [f32; N], wanted: [f64; N]) -> bool {
        found.iter().zip(wanted).all(|(found, wanted)| (f64::from(*found) - wanted).abs() < 2e-7)
    }

    #[test]
    fn readings_are_those_of_a_turned_unit() {
        assert_eq!(Sensors::default().imu(), None);
        let imu = Imu::new(&unit());
        // A level base: Ry(p)·Rx(r) of gravity (0, 0, −1), by hand.
        let (r, p): (f64, f64) = (0.03, -0.05);
        let gravity = [p.sin(), -p.cos() * r.sin(), -p.cos() * r.cos()];
        assert!(near(imu.direction([0.0, 0.0, -1.0]), gravity));
        // A turn about the vertical only shows on the unit's axes as gravity does, and the bias adds to it.
        let rates: [f64; 3] = std::array::from_fn(|k| -0.7 * gravity[k] + unit().gyro_bias[k]);
        assert!(near(imu.rates([0.0, 0.0, 0.7]), rates));
        // The attitude shows the same gravity.
        assert!(near(up(imu.attitude([1.0, 0.0, 0.0, 0.0])).map(|x| -x), gravity));
    }

    #[test]
    fn the_base_follows_from_the_readings() {
        let imu = Imu::new(&unit());
        let base = from_rpy(0.2, -0.1, 2.0);
        let (attitude, rates) = imu.base(imu.attitude(base.map(|x| x as f32)), imu.rates([0.3, -0.2, 1.1]));
        assert!(near(attitude, base) && near(rates, [0.3, -0.2, 1.1]), "{attitude:?} {rates:?}");
    }

    #[test]
    fn kernels_get_the_same_numbers() {
        let imu = Imu::new(&unit());
        let numbers = Imu::numbers(Some(&imu));
        assert_eq!(
            (numbers[0], numbers[1], numbers[5], numbers[14]),
            (1.0, imu.turn[0], imu.axes[0][0], 0.02)
        );
        assert_eq!(numbers[16], 0.005);
        assert_eq!(Imu::numbers(None), [0.0; IMU_NUMBERS]);
    }
}
