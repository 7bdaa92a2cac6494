//! Random states of a robot, the same on every machine.

use gaitfit_model::{Model, Root};

/// SplitMix64 (Steele, Lea and Flood 2014).
pub struct Random(pub u64);

impl Random {
    pub fn bits(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^ (z >> 31)
    }

    /// Uniform in [low, high).
    pub fn uniform(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * ((self.bits() >> 11) as f64 / (1u64 << 53) as f64)
    }

    /// Uniform in ±most, `n` times.
    pub fn signed(&mut self, n: usize, most: f64) -> Vec<f64> {
        (0..n).map(|_| self.uniform(-most, most)).collect()
    }
}

/// Joint angles within limits widened by `beyond` (rad), or ±1 rad where there are none.
pub fn angles(model: &Model, random: &mut Random, beyond: f64) -> Vec<f64> {
    let range = |joint: &gaitfit_model::Joint| joint.range.unwrap_or([-1.0, 1.0]);
    model.joints.iter().map(|j| random.uniform(range(j)[0] - beyond, range(j)[1] + beyond)).collect()
}

/// `qpos` with the base at `height` (m), turned anyhow if `tumbled`, else within about 0.3 rad of upright.
pub fn qpos(model: &Model, random: &mut Random, height: f64, tumbled: bool, beyond: f64) -> Vec<f64> {
    let mut qpos = Vec::with_capacity(model.nq());
    if model.root == Root::Floating {
        qpos.extend([random.uniform(-1.0, 1.0), random.uniform(-1.0, 1.0), height]);
        let mut quat = random.signed(4, if tumbled { 1.0 } else { 0.15 });
        if !tumbled {
            quat[0] = 1.0;
        }
        let norm = quat.iter().map(|x| x * x).sum::<f64>().sqrt();
        qpos.extend(quat.iter().map(|x| x / norm));
    }
    qpos.extend(angles(model, random, beyond));
    qpos
}
