//! Files that were damaged on the way, or made to harm: no panic, no hang, no runaway memory, and nothing is run.

#![allow(clippy::unwrap_used)]

use crate::common;

use common::{JOINTS, fixture, read};
use gaitfit_damage::{Bounds, Counting, Draws, Outcome, bytes, framed, peak, pickle};
use gaitfit_import::{LiveMcap, Mapping, McapHead, McapRow, Options, import};
use std::io::{Cursor, Read, Write};
use std::time::{Duration, Instant};

/// Sees how much memory readers take.
#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Pickles that repeat their few parts: what they unpack to is much larger than they are.
const PROGRAMS: &str = "pickle programs";

/// Small limits, so that a test would see a file that gets around them.
fn options(name: &str) -> Options {
    let mapping = match name {
        "odd.csv" => std::fs::read_to_string(fixture("odd.toml")).unwrap(),
        "episodes.h5" => format!("rate_hz = 200\n{JOINTS}[streams]\ntake = ['data/demo_0']"),
        _ => JOINTS.to_owned(),
    };
    let max_bytes = if name == PROGRAMS { 1 << 18 } else { 4 << 20 };
    Options { mapping: Mapping::parse(&mapping).unwrap(), max_bytes, max_values: (max_bytes / 4) as usize }
}

/// A zip archive with one of its files damaged, packed again so that its checksums hold.
fn mutated_inside(file: &[u8], draws: &mut Draws) -> Vec<u8> {
    let mut archive = zip::ZipArchive::new(Cursor::new(file)).unwrap();
    let chosen = draws.below(archive.len());
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for i in 0..archive.len() {
        let mut entry = archive.by_index(i).unwrap();
        let name = entry.name().unwrap().into_owned();
        let mut content = Vec::new();
        entry.read_to_end(&mut content).unwrap();
        if i == chosen {
            content = bytes(&content, draws);
        }
        let stored =
            zip::write::SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
        writer.start_file(name, stored).unwrap();
        writer.write_all(&content).unwrap();
    }
    writer.finish().unwrap().into_inner()
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

/// What reading one of these files may take, each of at most 64 kB. [`options`] would let them keep 8 MB of numbers.
const BOUNDS: Bounds = Bounds { bytes: 8 << 20, time: Duration::from_secs(10) };

/// Reads damaged files, each under one path.
fn attack(name: &str, rounds: usize, damaged: impl FnMut(&mut Draws) -> Vec<u8>) -> Outcome {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let options = options(name);
    gaitfit_damage::attack(name, rounds, BOUNDS, damaged, |file| {
        std::fs::write(&path, file).unwrap();
        let is_read = import(&[&path], &options).is_ok();
        // Some file systems flush a file that is overwritten; a new one is quicker.
        std::fs::remove_file(&path).unwrap();
        is_read
    })
}

fn attack_all(rounds: usize) {
    // `GAITFIT_FILES=motion.npz,pace.pt` attacks these alone.
    let wanted = std::env::var("GAITFIT_FILES").unwrap_or_default();
    let is_wanted = |name: &str| wanted.is_empty() || wanted.split(',').any(|file| file == name);
    for name in FILES.iter().chain(MORE_FILES).filter(|name| is_wanted(name)) {
        let file = std::fs::read(fixture(name)).unwrap();
        let archive = name.ends_with(".npz") || name.ends_with(".pt");
        attack(name, rounds, |draws| match archive && draws.below(2) == 0 {
            true => mutated_inside(&file, draws),
            false => bytes(&file, draws),
        });
    }
}

#[test]
fn damaged_files_are_refused_or_read() {
    attack_all(150);
}

/// MCAP files of this program, which are not packed, with damage inside their records: lengths and checksums hide none of it.
fn attack_records(rounds: usize) -> Outcome {
    let log = read("motion.csv", JOINTS).unwrap().trajectory;
    let mut file = Vec::new();
    let head = McapHead { joints: &log.joints, rate_hz: log.rate_hz, robot: None, gains: None, fell: false };
    let mut live = LiveMcap::live(&mut file, &head).unwrap();
    let width = log.joints.len();
    for row in 0..20 {
        let numbers = row * width..(row + 1) * width;
        live.row(&McapRow {
            time: log.time[row],
            position: &log.position[numbers.clone()],
            velocity: &log.velocity[numbers],
            quaternion: Some([1.0, 0.0, 0.0, 0.0]),
            angular_velocity: Some([0.1, 0.2, 0.3]),
            command: Some([0.5, 0.0, 0.0]),
            ..McapRow::default()
        })
        .unwrap();
    }
    drop(live);
    attack("records of MCAP", rounds, |draws| framed(&file, 8, draws))
}

#[test]
fn damaged_records_are_refused_or_read() {
    let outcome = attack_records(600);
    assert!(outcome.read > 50 && outcome.refused > 50, "{outcome:?}");
}

#[test]
fn pickles_that_no_program_writes_are_refused_or_read() {
    let outcome = attack(PROGRAMS, 1500, |draws| pickle(60, draws));
    assert!(outcome.read > 10, "{outcome:?}");
}

#[test]
#[ignore = "long: 20,000 damaged files of each kind"]
fn long_damaged_files_are_refused_or_read() {
    attack_all(20_000);
    attack_records(20_000);
    attack(PROGRAMS, 20_000, |draws| pickle(60, draws));
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

/// Small files whose parts are named again and again: each naming would take the memory of the part.
#[test]
fn what_is_named_often_is_not_copied_without_end() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("file");
    let small = Options { max_bytes: 1 << 20, max_values: 100_000, ..Options::default() };
    let long = vec![b'1'; 100_000];
    let mut pickle_start = b"\x80\x04B\xa0\x86\x01\0".to_vec();
    pickle_start.extend(&long);
    pickle_start.extend(b"q\0X\xa0\x86\x01\0");
    pickle_start.extend(&long);
    pickle_start.extend(b"q\x01cnumpy\ndtype\n\x8c\x02S1\x85Rq\x02cnumpy\ndtype\n\x8c\x06S65000\x85Rq\x03");
    let repeated = |part: &[u8], times: usize| part.repeat(times);
    let with = |body: Vec<u8>| [pickle_start.as_slice(), &body].concat();
    let array = b"cnumpy._core.numeric\n_frombuffer\n(h\0h\x02(J\xa0\x86\x01\0t\x8c\x01CtRq\x04";
    let keys: Vec<u8> =
        (0..2000).flat_map(|i| [format!("X\x04\0\0\0{i:04}").as_bytes(), b"h\x04"].concat()).collect();
    // A topic each with the whole definition of one type.
    let text = |text: &[u8]| [&(text.len() as u32).to_le_bytes(), text].concat();
    let record = |code: u8, body: Vec<u8>| [&[code], &(body.len() as u64).to_le_bytes()[..], &body].concat();
    let fields: String = (0..15_000).map(|i| format!("int8 a{i}\n")).collect();
    let schema = [vec![1, 0], text(b"p/T"), text(b"ros2msg"), text(fields.as_bytes())].concat();
    let channel = |i: u16| {
        let topic = text(format!("/t{i}").as_bytes());
        record(4, [&i.to_le_bytes(), &[1, 0][..], &topic, &text(b"cdr"), &text(b"")].concat())
    };
    let channels: Vec<u8> = (0..5000).flat_map(channel).collect();
    for (what, file) in [
        ("classes", with([repeated(b"h\x01h\x01\x93", 5000), b".".to_vec()].concat())),
        (
            "words in a list",
            with([b"}\x8c\x01a(".to_vec(), repeated(b"h\x01", 5000), b"ls.".to_vec()].concat()),
        ),
        ("arrays of words", with([array.to_vec(), b"}(".to_vec(), keys, b"u.".to_vec()].concat())),
        ("words of bytes", with(repeated(b"cnumpy._core.multiarray\nscalar\nh\x03h\0\x86R", 5000))),
        ("keys", with([b"}(".to_vec(), repeated(b"h\x01}(h\x01K\x01u", 5000), b"u.".to_vec()].concat())),
        ("definitions", [b"\x89MCAP0\r\n".to_vec(), record(3, schema), channels].concat()),
    ] {
        std::fs::write(&path, file).unwrap();
        let (result, bytes) = peak(|| import(&[&path], &small));
        let error = result.unwrap_err().to_string();
        assert!(error.contains("more than"), "{what}: {error}");
        assert!(bytes < 24 << 20, "{what}: {bytes} bytes");
    }
}
