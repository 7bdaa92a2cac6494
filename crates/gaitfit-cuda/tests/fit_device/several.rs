//! The candidates of one fit on several GPUs, or in several sessions on one.

use std::sync::Mutex;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::time::Instant;

use gaitfit_cuda::fit::{Compared, FitError, MultiGpu, Parts, Subject, Tables, Tracks};
use gaitfit_cuda::runtime::Device;
use gaitfit_policy::follow::Job;

use super::{ALL, pretend, robot, scripts, walking};

/// `count` devices: all GPUs in turn, so the first one again where there is no other.
fn devices(count: usize) -> Vec<Device> {
    let all: Vec<Device> = (0..).map_while(|number| Device::open(number).ok()).take(count).collect();
    assert!(!all.is_empty(), "there is no GPU");
    all.into_iter().cycle().take(count).collect()
}

/// Robots that walk, fall, are reset, have networks and torque noise, in one batch; whatever the number of sessions, and
/// with fewer candidates than sessions, each has the same bits.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_candidates_have_the_same_bits_on_any_number_of_gpus() {
    let (task, policy) = walking(4);
    let scripts = scripts(&task, &policy, 9, 60);
    let subject = Subject::Walk(&task.walker, &policy);
    let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
    let job = |number: usize| {
        let joints = [&[][..], &ALL, &[11]][number % 3];
        let reset_every = [None, Some(1), None, Some(10), None][number % 5];
        Job { candidate: robot(number, joints), reset_every, seed: number as u64 }
    };
    let mut jobs: Vec<Job> = (0..23).map(job).collect();
    // It falls, for nothing resets it.
    assert!(jobs[12].reset_every.is_none());
    jobs[12].candidate.robot.kp_scale = vec![0.15; 12];
    let compared: Vec<Compared> =
        (0..jobs.len()).map(|k| if k % 4 == 1 { Compared::Squares } else { Compared::Distances }).collect();
    let dimensions = subject.dimensions();
    // Bits, for a diverged candidate has numbers that are none.
    let bits = |parts: &[Parts]| -> Vec<(Vec<u32>, Vec<u64>)> {
        parts.iter().map(|one| (one.ends.clone(), one.pieces.iter().map(|x| x.to_bits()).collect())).collect()
    };
    let run = |count: usize, most: usize| {
        let mut gpus = MultiGpu::new(&devices(count), tables.clone(), 4).unwrap();
        gpus.measure(pretend(gpus.tables(), dimensions), dimensions).unwrap();
        let jobs = &jobs[..most];
        let [parts, again] =
            [0; 2].map(|_| bits(&gpus.parts(subject, jobs, &compared[..most], &|| false).unwrap()));
        assert!(parts == again, "other bits the second time");
        let rows = Mutex::new(vec![(Vec::new(), None); jobs.len() * scripts.len()]);
        let consume = |job: usize, recording: usize, tracks: Tracks<'_>| {
            rows.lock().unwrap()[job * scripts.len() + recording] = (tracks.rows.to_vec(), tracks.fell_at);
        };
        gpus.tracks(subject, jobs, &consume, &|| false).unwrap();
        (parts, rows.into_inner().unwrap())
    };
    let (parts, rows) = run(1, jobs.len());
    assert!(rows.iter().any(|(_, fell_at)| fell_at.is_some()), "no robot fell");
    for (count, most) in [(2, 23), (3, 23), (2, 8), (3, 2), (2, 1)] {
        let (costs, signals) = run(count, most);
        assert!(costs == parts[..most], "costs of {most} candidates on {count} GPUs differ");
        assert!(signals == rows[..most * scripts.len()], "signals of {most} on {count} GPUs differ");
        println!("{most} candidates in {count} sessions on {} GPUs: same bits", {
            let mut numbers: Vec<usize> = devices(count).iter().map(|one| one.info().ordinal).collect();
            numbers.sort_unstable();
            numbers.dedup();
            numbers.len()
        });
    }
}

/// Both sessions give up, and go on afterwards.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_sessions_are_cancelled_together() {
    let (task, policy) = walking(4);
    let scripts = scripts(&task, &policy, 4, 40);
    let subject = Subject::Walk(&task.walker, &policy);
    let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
    let mut gpus = MultiGpu::new(&devices(2), tables, 2).unwrap();
    let dimensions = subject.dimensions();
    gpus.measure(pretend(gpus.tables(), dimensions), dimensions).unwrap();
    let jobs: Vec<Job> =
        (0..6).map(|number| Job { candidate: robot(number, &[]), reset_every: None, seed: 1 }).collect();
    let asked = AtomicUsize::new(0);
    let cancel = || asked.fetch_add(1, Ordering::Relaxed) > 0;
    let error = gpus.parts(subject, &jobs, &[Compared::Squares; 6], &cancel).unwrap_err();
    assert!(matches!(error, FitError::Cancelled), "{error}");
    assert_eq!(gpus.parts(subject, &jobs, &[Compared::Squares; 6], &|| false).unwrap().len(), 6);
}

/// How long a generation takes in one session and in two: a line for each size.
#[test]
#[ignore = "needs an NVIDIA GPU"]
fn gpu_generations_of_one_and_of_two_are_timed() {
    let (task, policy) = walking(20);
    let scripts = scripts(&task, &policy, 64, 200);
    let subject = Subject::Walk(&task.walker, &policy);
    let tables = Tables::walk(&task.walker, &policy, &scripts).unwrap();
    let dimensions = subject.dimensions();
    for (label, population, joints) in [
        ("1 kHz", 24, &[][..]),
        ("1 kHz, eight searches", 192, &[][..]),
        ("1 kHz, 12 ResidAct and noise, eight searches", 200, &ALL[..]),
    ] {
        let jobs: Vec<Job> = (0..population)
            .map(|number| Job { candidate: robot(number % 25, joints), reset_every: None, seed: 1 })
            .collect();
        let compared = vec![Compared::Distances; population];
        let times = [1, 2].map(|count| {
            let mut gpus = MultiGpu::new(&devices(count), tables.clone(), 16).unwrap();
            gpus.measure(pretend(gpus.tables(), dimensions), dimensions).unwrap();
            let mut time = || {
                let start = Instant::now();
                gpus.parts(subject, &jobs, &compared, &|| false).unwrap();
                1e3 * start.elapsed().as_secs_f64()
            };
            let first = time();
            (first, (0..5).map(|_| time()).fold(f64::INFINITY, f64::min))
        });
        let numbers: Vec<usize> = devices(2).iter().map(|one| one.info().ordinal).collect();
        let [(ready, alone), (ready_two, shared)] = times;
        println!(
            "{label}: {population} candidates x 64 x 4 s: one session {alone:.2} ms (first {ready:.0} ms), two on GPUs \
             {numbers:?} {shared:.2} ms (first {ready_two:.0} ms)"
        );
    }
}
