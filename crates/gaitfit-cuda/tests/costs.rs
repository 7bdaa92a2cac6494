//! Distances and sums of squares of many candidates against those of `gaitfit-adapt`.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use crate::host;

use gaitfit_adapt::cost::{sort_f32, wasserstein1};
use gaitfit_cuda::costs::{Comparison, Sizes, pooled, program, shared};
use gaitfit_cuda::ppo::{Array, Id, Kind, Launch, Plan, Value};
use gaitfit_cuda::runtime::{Buffer, Device, Nvrtc, Shape, Stream, compile};
use gaitfit_random::{Purpose, Stream as Draws};
use host::{Arrays, bytes, doubles};

const SIZES: Sizes = Sizes { candidates: 3, recordings: 2, samples: 70, dimensions: 4, skip: 5 };

/// Signals of all candidates, where their recordings end, the robot's samples.
fn problem(sizes: Sizes) -> (Vec<f32>, Vec<u32>, Vec<f64>) {
    let Sizes { candidates, recordings, samples, dimensions, .. } = sizes;
    let size = recordings * samples * dimensions;
    let draw = |number: u32, count: usize| {
        let stream = Draws::new(3, Purpose::BOOTSTRAP).environment(number);
        (0..count).map(move |i| stream.normal(i as u32))
    };
    let signals = draw(0, candidates * size).map(|x| (x * 1.3 + 0.1) as f32).collect();
    // One candidate falls in its last recording, another before anything counts.
    let mut ends = vec![samples as u32; candidates * recordings];
    ends[2 * recordings - 1] = samples as u32 / 2;
    ends[2 * recordings] = sizes.skip as u32;
    (signals, ends, draw(1, size).collect())
}

/// What the CPU computes: distances and sums of squares.
fn expected(sizes: Sizes, signals: &[f32], ends: &[u32], measured: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let Sizes { candidates, recordings, samples, dimensions, skip } = sizes;
    let reference = pooled(sizes, measured);
    let counted = reference.len() / dimensions;
    let at = |run: usize, sample: usize, dimension: usize| (run * samples + sample) * dimensions + dimension;
    let (mut distances, mut squares) = (Vec::new(), vec![0.0; candidates * recordings * dimensions]);
    for candidate in 0..candidates {
        for dimension in 0..dimensions {
            let mut pool = Vec::new();
            for recording in 0..recordings {
                let run = candidate * recordings + recording;
                for sample in skip..ends[run] as usize {
                    let x = signals[at(run, sample, dimension)];
                    pool.push(x);
                    let difference = f64::from(x) - measured[at(recording, sample, dimension)];
                    squares[run * dimensions + dimension] += difference * difference;
                }
            }
            sort_f32(&mut pool);
            distances.push(wasserstein1(&pool, &reference[dimension * counted..(dimension + 1) * counted]));
        }
    }
    (distances, squares)
}

fn compare(costs: (&[f64], &[f64]), wanted: (&[f64], &[f64])) {
    assert_eq!(costs.0.len(), wanted.0.len());
    for (value, wanted) in costs.0.iter().zip(wanted.0) {
        assert!((value - wanted).abs() < 1e-13 * wanted, "{value} {wanted}");
    }
    assert_eq!(costs.1, wanted.1);
}

#[test]
#[ignore = "needs g++"]
fn cxx_costs_are_the_cpus() {
    // With all keys in global memory, and in shared memory, without and with room that is left.
    costs_by(0);
    costs_by(101);
    costs_by(SIZES.items(THREADS));
}

const THREADS: u32 = 64;

fn costs_by(items: usize) {
    let (signals, ends, measured) = problem(SIZES);
    let sorted = pooled(SIZES, &measured);
    let Sizes { candidates, recordings, samples, dimensions, skip } = SIZES;
    let mut arrays = Vec::new();
    let mut array = |name, kind, length| {
        arrays.push(Array { name, kind, length });
        Value::Array(Id(arrays.len() - 1))
    };
    let signals_id = array("signals", Kind::F32, signals.len());
    let ends_id = array("ends", Kind::U32, ends.len());
    let sorted_id = array("sorted", Kind::F64, sorted.len());
    let measured_id = array("measured", Kind::F64, measured.len());
    let scratch_id = array("scratch", Kind::U32, candidates * dimensions * 2 * recordings * samples);
    let distances_id = array("distances", Kind::F64, candidates * dimensions);
    let squares_id = array("squares", Kind::F64, candidates * recordings * dimensions);
    let word = |number: usize| Value::U32(number as u32);
    let counted = sorted.len() / dimensions;
    let shape = Shape {
        grid: [candidates as u32, dimensions as u32, 1],
        block: [THREADS, 1, 1],
        shared: shared(THREADS, items),
    };
    let distances = Launch {
        kernel: "wasserstein",
        shape,
        arguments: vec![
            word(recordings),
            word(samples),
            word(dimensions),
            word(skip),
            signals_id,
            ends_id,
            sorted_id,
            word(counted),
            scratch_id,
            distances_id,
        ],
    };
    let squares = Launch {
        kernel: "squared_differences",
        shape: Shape::cover(candidates * recordings * dimensions, 64),
        arguments: vec![
            word(candidates),
            word(recordings),
            word(samples),
            word(dimensions),
            word(skip),
            signals_id,
            ends_id,
            measured_id,
            squares_id,
        ],
    };
    let plan = Plan::from_parts(arrays, vec![squares, distances]);
    let given = |signals: &[f32]| {
        Arrays::from([
            ("signals", bytes(signals, f32::to_ne_bytes)),
            ("ends", bytes(&ends, u32::to_ne_bytes)),
            ("sorted", bytes(&sorted, f64::to_ne_bytes)),
            ("measured", bytes(&measured, f64::to_ne_bytes)),
        ])
    };
    let text = program(items).text;
    let out = host::run(&text, &plan, &given(&signals), &[]);
    let wanted = expected(SIZES, &signals, &ends, &measured);
    compare((&doubles(&out["distances"]), &doubles(&out["squares"])), (&wanted.0, &wanted.1));
    // A number that is none spoils its dimension, but not before the samples that count.
    let mut spoilt = signals;
    spoilt[2] = f32::NAN;
    spoilt[dimensions * skip + 1] = f32::INFINITY;
    let out = host::run(&text, &plan, &given(&spoilt), &[]);
    let distances = doubles(&out["distances"]);
    assert!(distances[1].is_nan() && distances[2] == wanted.0[2], "{distances:?}");
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_the_costs_without_many_spills() {
    // Bytes that a thread may spill: with many keys in its registers it has few left for where they are counted.
    for (items, most) in [(0, 0), (5, 0), (77, 512), (101, 512)] {
        let program = program(items).option("--ptxas-options=-v");
        let log = compile(Nvrtc::get().unwrap(), &program, (8, 0), None).unwrap().image.log;
        let spills = |line: &str| -> Option<u32> {
            line.split_once(" bytes spill stores")?.0.rsplit(' ').next()?.parse().ok()
        };
        let spills: Vec<u32> = log.lines().filter_map(spills).collect();
        assert!(!spills.is_empty() && spills.iter().all(|bytes| *bytes <= most), "{items}: {log}");
    }
}

#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_costs_are_the_cpus() {
    let device = Device::open(0).unwrap();
    let stream = Stream::new(&device).unwrap();
    // The second one's keys just fit into a multiprocessor's memory. The third one's do not.
    for (samples, recordings) in [(800, 16), (808, 64), (10_000, 8)] {
        let sizes = Sizes { candidates: 4, recordings, samples, dimensions: 36, skip: 50 };
        let (signals, ends, measured) = problem(sizes);
        let mut comparison = Comparison::new(&device, sizes, &measured).unwrap();
        let signals_there = Buffer::from_slice(&device, "signals", &signals).unwrap();
        let ends_there = Buffer::from_slice(&device, "ends", &ends).unwrap();
        let distances = comparison.distances(&stream, &signals_there, &ends_there).unwrap();
        let squares = comparison.squared_differences(&stream, &signals_there, &ends_there).unwrap();
        let wanted = expected(sizes, &signals, &ends, &measured);
        compare((&distances, &squares), (&wanted.0, &wanted.1));
        assert!(
            comparison.distances(&stream, &signals_there, &Buffer::new(&device, "ends", 1).unwrap()).is_err()
        );
    }
}
