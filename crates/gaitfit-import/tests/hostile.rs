//! Files that were damaged on the way, or made to harm: no panic, no hang, no runaway memory, and nothing is run.

#![allow(clippy::unwrap_used)]

use crate::common;

use common::{JOINTS, fixture};
use gaitfit_import::{Mapping, Options, import};
use std::io::{Cursor, Read, Write};
use std::time::{Duration, Instant};

/// Small limits, so that a test would see a file that gets around them.
fn options(name: &str) -> Options {
    let mapping = match name {
        "odd.csv" => std::fs::read_to_string(fixture("odd.toml")).unwrap(),
        "episodes.h5" => format!("rate_hz = 200\n{JOINTS}[streams]\ntake = ['data/demo_0']"),
        _ => JOINTS.to_owned(),
    };
    Options { mapping: Mapping::parse(&mapping).unwrap(), max_bytes: 4 << 20, max_values: 1_000_000 }
}

/// A zip archive with one of its files damaged, packed again so that its checksums hold.
fn mutated_inside(bytes: &[u8], draws: &mut Draws) -> Vec<u8> {
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let chosen = draws.below(archive.len());
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).unwrap();
        let name = entry.name().unwrap().into_owned();
        let mut content = Vec::new();
        entry.read_to_end(&mut content).unwrap();
        if i == chosen {
            content = mutated(&content, draws);
        }
        let stored =
            zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        writer.start_file(name, stored).unwrap();
        writer.write_all(&content).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// Draws, by xorshift.
struct Draws(u64);

impl Draws {
    fn below(&mut self, limit: usize) -> usize {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as usize % limit.max(1)
    }
}

/// A file with a few bytes changed, put in, taken out or repeated, or cut off.
fn mutated(bytes: &[u8], draws: &mut Draws) -> Vec<u8> {
    let mut out = bytes.to_vec();
    for _ in 0..1 + draws.below(4) {
        if out.is_empty() {
            break;
        }
        // Headers and trailers say more than the middle.
        let at = match draws.below(3) {
            0 => draws.below(out.len().min(256)),
            1 => out.len() - 1 - draws.below(out.len().min(256)),
            _ => draws.below(out.len()),
        };
        match draws.below(8) {
            0 => out[at] ^= 1 << draws.below(8),
            1 => out[at] = [0, 1, 0x7f, 0x80, 0xff][draws.below(5)],
            2 => out[at] = draws.below(256) as u8,
            3 => {
                let end = (at + 8).min(out.len());
                out[at..end].fill([0, 0xff][draws.below(2)]);
            }
            4 => out.truncate(at),
            5 => {
                let end = (at + 1 + draws.below(64)).min(out.len());
                out.drain(at..end);
            }
            6 => {
                let end = (at + 1 + draws.below(64)).min(out.len());
                let part = out[at..end].to_vec();
                out.splice(at..at, part);
            }
            _ => {
                let number = (draws.below(1 << 20) as u32).to_le_bytes();
                out.splice(at..at, number);
            }
        }
    }
    out
}

const FILES: &[&str] = &[
    "joint_states.mcap",
    "unitree_go.mcap",
    "two_rates.mcap",
    "bag/bag.db3",
    "motion.npz",
    "pace.pt",
    "motion.pt",
    "motion.pkl",
    "walk_these_ways.pkl",
    "odd.csv",
    "plotjuggler.csv",
    "motion.csv",
];

/// Files that the feature `all-formats` reads.
const MORE_FILES: &[&str] = match cfg!(feature = "all-formats") {
    true => &[
        "motion.parquet",
        "lists.parquet",
        "kinds.parquet",
        "motion.arrow",
        "lists.arrow",
        "stream.arrow",
        "motion.h5",
        "episodes.h5",
    ],
    false => &[],
};

fn attack(each: usize) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    // `GAITFIT_FILES=motion.npz,pace.pt` attacks these alone.
    let wanted = std::env::var("GAITFIT_FILES").unwrap_or_default();
    let is_wanted = |name: &str| wanted.is_empty() || wanted.split(',').any(|file| file == name);
    for (i, name) in FILES.iter().chain(MORE_FILES).enumerate().filter(|(_, name)| is_wanted(name)) {
        let bytes = std::fs::read(fixture(name)).unwrap();
        let options = options(name);
        let archive = name.ends_with(".npz") || name.ends_with(".pt");
        let mut draws = Draws(0x9e37_79b9_7f4a_7c15 ^ (i as u64 + 1));
        let (mut read, mut slowest) = (0, Duration::ZERO);
        for round in 0..each {
            let inside = archive && round % 2 == 0;
            let damaged =
                if inside { mutated_inside(&bytes, &mut draws) } else { mutated(&bytes, &mut draws) };
            std::fs::write(&path, damaged).unwrap();
            let start = Instant::now();
            read += usize::from(import(&[&path], &options).is_ok());
            let took = start.elapsed();
            slowest = slowest.max(took);
            assert!(took < Duration::from_secs(10), "{name}: file {round} took {took:?}");
        }
        eprintln!(
            "{name}: {each} files, {read} of them read, the slowest in {slowest:?}, peak {} MB",
            peak_mb()
        );
        assert!(peak_mb() < 600, "{name}: {} MB", peak_mb());
    }
}

/// Most memory that this process has had, MB; 0 where the system does not say.
fn peak_mb() -> usize {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find(|line| line.starts_with("VmHWM:")).unwrap_or("");
    line.split_whitespace().nth(1).and_then(|kb| kb.parse::<usize>().ok()).unwrap_or(0) / 1024
}

#[test]
fn damaged_files_are_refused_or_read() {
    attack(150);
}

#[test]
#[ignore = "long: 20,000 damaged files of each kind"]
fn long_damaged_files_are_refused_or_read() {
    attack(20_000);
}

/// Pickles that would run a program in Python.
#[test]
fn nothing_in_a_pickle_is_run() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace");
    let touch = format!("touch {}", trace.display());
    let short = |text: &str| [&[0x8c, text.len() as u8], text.as_bytes()].concat();
    let calls: Vec<Vec<u8>> = vec![
        [b"cos\nsystem\n(S'".as_slice(), touch.as_bytes(), b"'\ntR."].concat(),
        [
            b"\x80\x02cposix\nsystem\nX".as_slice(),
            &(touch.len() as u32).to_le_bytes(),
            touch.as_bytes(),
            b"\x85R.",
        ]
        .concat(),
        [b"\x80\x04".as_slice(), &short("builtins"), &short("exec"), b"\x93", &short("import os"), b"\x85R."]
            .concat(),
        [
            b"\x80\x04".as_slice(),
            &short("subprocess"),
            &short("Popen"),
            b"\x93",
            &short("touch x"),
            b"\x85\x81.",
        ]
        .concat(),
        [b"(S'".as_slice(), touch.as_bytes(), b"'\nios\nsystem\n."].concat(),
        [b"\x80\x04}".as_slice(), &short("q"), b"cbuiltins\neval\n", &short("1"), b"\x85Rs."].concat(),
    ];
    for (i, bytes) in calls.iter().enumerate() {
        let mut padded = bytes.clone();
        if padded[0] != 0x80 {
            padded = [b"\x80\x02".as_slice(), bytes].concat();
        }
        let path = folder.path().join(format!("{i}.pkl"));
        std::fs::write(&path, padded).unwrap();
        let error = import(&[&path], &Options::default()).unwrap_err().to_string();
        assert!(error.contains("Nothing was run") || error.contains("instruction 0x69"), "{i}: {error}");
        assert!(!trace.exists());
    }
}

/// Small files that say they are huge, or refer to themselves.
#[test]
fn sizes_that_files_state_are_not_believed() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        let start = Instant::now();
        let error = import(&[&path], &Options::default()).unwrap_err().to_string();
        assert!(start.elapsed() < Duration::from_secs(5), "{error}");
        error
    };
    let header = "{'descr': '<f8', 'fortran_order': False, 'shape': (4000000000, 4000000000), }";
    let npy =
        [b"\x93NUMPY\x01\x00".as_slice(), &(header.len() as u16).to_le_bytes(), header.as_bytes()].concat();
    assert!(refused(&npy).contains("cut short"));
    let long = [b"\x93NUMPY\x02\x00".as_slice(), &u32::MAX.to_le_bytes(), &[b'('; 64]].concat();
    assert!(refused(&long).contains("too long"));
    // A pickle of four gigabytes of text.
    assert!(refused(b"\x80\x02X\xff\xff\xff\xffabc.").contains("cut short"));
    // A list in itself, a dictionary in itself.
    assert!(refused(b"\x80\x02]q\x00h\x00a.").contains("no dictionary"));
    assert!(refused(b"\x80\x02}q\x00U\x01ah\x00s.").contains("no dictionary"));
    // Lists of lists of lists, each ten times the one before.
    let mut laughs = b"\x80\x02]".to_vec();
    for level in 0..30u8 {
        laughs.extend([b'q', level, b']', b'(']);
        (0..10).for_each(|_| laughs.extend([b'h', level]));
        laughs.push(b'e');
    }
    laughs.extend(b"q\xff}U\x01qh\xffs.");
    refused(&laughs);
    // Three billion numbers in HDF5 chunks that were never written, six million in Parquet's runs.
    let few = Options { max_values: 1_000_000, ..options("motion.csv") };
    let all = cfg!(feature = "all-formats");
    for name in ["huge.h5", "huge.parquet"].into_iter().filter(|_| all) {
        let error = import(&[fixture(name)], &few).unwrap_err().to_string();
        assert!(error.contains("more than 1000000 numbers"), "{name}: {error}");
    }
    let mut record = b"\x89MCAP0\r\n\x05".to_vec();
    record.extend(u64::MAX.to_le_bytes());
    assert!(refused(&record).contains("no messages"));
    // Zeros, packed a thousandfold: the budget ends it.
    let small = Options { max_bytes: 1 << 20, ..Options::default() };
    let zeros = lz4_bomb();
    std::fs::write(&path, zeros).unwrap();
    let error = import(&[&path], &small).unwrap_err().to_string();
    assert!(error.contains("when unpacked"), "{error}");
}

/// An MCAP file with a chunk of 64 MB of zeros.
fn lz4_bomb() -> Vec<u8> {
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    (0..64).for_each(|_| encoder.write_all(&[0; 1 << 20]).unwrap());
    let packed = encoder.finish().unwrap();
    let mut body = [0u8; 16].to_vec();
    body.extend((64u64 << 20).to_le_bytes());
    body.extend(0u32.to_le_bytes());
    body.extend(3u32.to_le_bytes());
    body.extend(b"lz4");
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    let mut file = b"\x89MCAP0\r\n\x06".to_vec();
    file.extend((body.len() as u64).to_le_bytes());
    file.extend(body);
    file
}
