//! The messages as the vendor's C structs lie in memory, and the checksum over them.
//!
//! The checksum is over this padded layout, not over the bytes on the wire (unitree_sdk2_python, `utils/crc.py`).

use super::message::{LowCmd, LowState};

/// Bytes of a command as a C struct.
pub const CMD_BYTES: usize = 812;
/// Bytes of a state as a C struct.
pub const STATE_BYTES: usize = 1180;

/// Polynomial of the checksum.
const POLYNOMIAL: u32 = 0x04C1_1DB7;

/// One shift of eight bits for each value of the top byte.
const TABLE: [u32; 256] = table();

const fn table() -> [u32; 256] {
    let mut table = [0; 256];
    let mut byte = 0;
    while byte < 256 {
        // Nothing is reflected, so bits enter at the top.
        let mut crc = (byte as u32) << 24;
        let mut bit = 0;
        while bit < 8 {
            crc = if crc & 0x8000_0000 != 0 { (crc << 1) ^ POLYNOMIAL } else { crc << 1 };
            bit += 1;
        }
        table[byte] = crc;
        byte += 1;
    }
    table
}

/// CRC-32 over little-endian words: polynomial 0x04C11DB7, initial value of ones, nothing reflected, no final xor.
pub(super) fn crc(words: &[u8]) -> u32 {
    // All layouts are whole words, so no bytes are left over.
    let (words, _) = words.as_chunks::<4>();
    words.iter().fold(u32::MAX, |crc, word| {
        // The most significant byte of a word goes first: the last in memory.
        word.iter().rev().fold(crc, |crc, &byte| (crc << 8) ^ TABLE[((crc >> 24) as u8 ^ byte) as usize])
    })
}

/// A struct's memory, filled from its beginning.
pub(super) struct Memory<const N: usize> {
    bytes: [u8; N],
    used: usize,
}

impl<const N: usize> Memory<N> {
    pub(super) fn new() -> Self {
        Self { bytes: [0; N], used: 0 }
    }

    pub(super) fn bytes(&mut self, bytes: &[u8]) -> &mut Self {
        self.bytes[self.used..self.used + bytes.len()].copy_from_slice(bytes);
        self.used += bytes.len();
        self
    }

    pub(super) fn words<const K: usize>(&mut self, words: [u32; K]) -> &mut Self {
        words.into_iter().for_each(|word| {
            self.bytes(&word.to_le_bytes());
        });
        self
    }

    pub(super) fn floats<const K: usize>(&mut self, floats: [f32; K]) -> &mut Self {
        self.words(floats.map(f32::to_bits))
    }

    pub(super) fn shorts<const K: usize>(&mut self, shorts: [u16; K]) -> &mut Self {
        shorts.into_iter().for_each(|short| {
            self.bytes(&short.to_le_bytes());
        });
        self
    }

    /// The bytes.
    pub(super) fn into_bytes(self) -> [u8; N] {
        self.bytes
    }

    /// Zeros up to a multiple of four bytes.
    pub(super) fn align(&mut self) -> &mut Self {
        self.used = self.used.next_multiple_of(4);
        self
    }
}

impl LowCmd {
    /// The vendor's C struct of this command, little-endian.
    pub fn layout(&self) -> [u8; CMD_BYTES] {
        // The gaps are those of the C struct, as in `LowState::layout`.
        let mut memory = Memory::new();
        memory.bytes(&self.head).bytes(&[self.level_flag, self.frame_reserve]);
        memory.words(self.sn).words(self.version).shorts([self.bandwidth]).align();
        for motor in &self.motor_cmd {
            memory.bytes(&[motor.mode]).align();
            memory.floats([motor.q, motor.dq, motor.tau, motor.kp, motor.kd]).words(motor.reserve);
        }
        memory.bytes(&[self.bms_cmd.off]).bytes(&self.bms_cmd.reserve);
        memory.bytes(self.wireless_remote.as_flattened()).bytes(&self.led).bytes(&self.fan);
        memory.bytes(&[self.gpio]).align().words([self.reserve, self.crc]);
        memory.bytes
    }

    /// Checksum over all of the layout but its last word, which is the checksum.
    pub fn checksum(&self) -> u32 {
        crc(&self.layout()[..CMD_BYTES - 4])
    }

    /// Returns the command with its checksum filled in.
    pub fn sealed(mut self) -> Self {
        self.crc = self.checksum();
        self
    }
}

impl LowState {
    /// The vendor's C struct of this state, little-endian.
    pub fn layout(&self) -> [u8; STATE_BYTES] {
        // The order and the gaps are those of the C struct: a group ends on a boundary of 4 bytes.
        let mut memory = Memory::new();
        memory.bytes(&self.head).bytes(&[self.level_flag, self.frame_reserve]);
        memory.words(self.sn).words(self.version).shorts([self.bandwidth]).align();
        let imu = &self.imu_state;
        memory.floats(imu.quaternion).floats(imu.gyroscope).floats(imu.accelerometer).floats(imu.rpy);
        memory.bytes(&[imu.temperature]).align();
        for motor in &self.motor_state {
            memory.bytes(&[motor.mode]).align();
            memory.floats([motor.q, motor.dq, motor.ddq, motor.tau_est]);
            memory.floats([motor.q_raw, motor.dq_raw, motor.ddq_raw]);
            memory.bytes(&[motor.temperature]).align().words([motor.lost]).words(motor.reserve);
        }
        let battery = &self.bms_state;
        memory.bytes(&[battery.version_high, battery.version_low, battery.status, battery.soc]);
        memory.bytes(&battery.current.to_le_bytes()).shorts([battery.cycle]);
        memory.bytes(&battery.bq_ntc).bytes(&battery.mcu_ntc).shorts(battery.cell_vol);
        memory.shorts(self.foot_force.map(i16::cast_unsigned));
        memory.shorts(self.foot_force_est.map(i16::cast_unsigned)).align();
        memory.words([self.tick]).bytes(self.wireless_remote.as_flattened()).bytes(&[self.bit_flag]).align();
        memory.floats([self.adc_reel]).bytes(&[self.temperature_ntc1, self.temperature_ntc2]).align();
        memory.floats([self.power_v, self.power_a]).shorts(self.fan_frequency);
        memory.words([self.reserve, self.crc]);
        memory.bytes
    }

    /// Checksum over all of the layout but its last word, which is the checksum.
    pub fn checksum(&self) -> u32 {
        crc(&self.layout()[..STATE_BYTES - 4])
    }

    /// Returns the state with its checksum filled in.
    pub fn sealed(mut self) -> Self {
        self.crc = self.checksum();
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Bit by bit, as the definition says.
    fn slow(words: &[u8]) -> u32 {
        let (words, _) = words.as_chunks::<4>();
        let mut crc = u32::MAX;
        for word in words {
            crc ^= u32::from_le_bytes(*word);
            for _ in 0..32 {
                crc = if crc & 0x8000_0000 != 0 { (crc << 1) ^ POLYNOMIAL } else { crc << 1 };
            }
        }
        crc
    }

    #[test]
    fn the_table_is_the_polynomial_division() {
        let bytes: Vec<u8> = (0..400u32).map(|k| (k * k + 7 * k) as u8).collect();
        assert_eq!(crc(&bytes), slow(&bytes));
        assert_ne!(crc(&bytes), crc(&bytes[4..]));
    }

    #[test]
    fn layouts_are_filled_to_the_end() {
        let command = LowCmd { crc: 0x0403_0201, ..LowCmd::default() };
        assert_eq!(command.layout()[CMD_BYTES - 4..], [1, 2, 3, 4]);
        let state = LowState { crc: 0x0403_0201, ..LowState::default() };
        assert_eq!(state.layout()[STATE_BYTES - 4..], [1, 2, 3, 4]);
    }
}
