//! The text of a program: compiled as C++, and by NVIDIA's compiler.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::process::Command;

use crate::common::{Sample, feet, on_box, on_field, recorded, robot, samples, shared, touching};
use gaitfit_cuda::emit::{Class, Layout, PeriodProgram, body, cuda, head, tables};
use gaitfit_cuda::runtime::{Nvrtc, Program, compile};
use gaitfit_model::{Cone, Model, ObstacleShape, SelfContact};
use gaitfit_physics::trace::{Input, Output, PeriodGraph};
use gaitfit_physics::{Preset, Settings};
use sha2::{Digest, Sha256};

const TAPS: usize = 2;
const SUBSTEPS: usize = 3;

struct Case {
    period: PeriodGraph,
    program: PeriodProgram,
    layout: Layout,
}

fn case(model: &Model, preset: Preset, lanes: usize, min_guarded: usize, networks: bool) -> Case {
    let settings = settings(model, preset);
    let (period, tree) = recorded(model, &settings, TAPS, SUBSTEPS, networks);
    let program = shared(&period, &tree, lanes, min_guarded);
    let layout = Layout::new(&period, &program).unwrap();
    Case { period, program, layout }
}

fn settings(model: &Model, preset: Preset) -> Settings {
    Settings { timestep: 0.005, ..Settings::new(&model.options, preset) }
}

/// Numbers of a class in a tile, of all physics steps.
fn length(case: &Case, class: Class) -> usize {
    case.layout.size(class) * if class == Class::Disturbance { SUBSTEPS } else { 1 }
}

/// Numbers of a tile filled from its environments' inputs.
fn tile(case: &Case, class: Class, samples: &[Sample]) -> Vec<f32> {
    let layout = &case.layout;
    let mut numbers = vec![f32::NAN; length(case, class)];
    for (environment, sample) in samples.iter().enumerate() {
        let disturbed = layout.inputs.iter().filter(|place| place.class == Class::Disturbance);
        let disturbed: Vec<_> = disturbed.filter(|_| class == Class::Disturbance).collect();
        for (k, &value) in sample.disturbance.iter().enumerate().filter(|_| !disturbed.is_empty()) {
            let (step, joint) = (k / disturbed.len(), k % disturbed.len());
            let at = step * layout.size(class) + layout.offset(*disturbed[joint], environment);
            numbers[at] = value as f32;
        }
        if class == Class::Disturbance {
            continue;
        }
        for (place, &value) in layout.inputs.iter().zip(&sample.inputs) {
            if place.class == class {
                numbers[layout.offset(*place, environment)] = value as f32;
            }
        }
    }
    numbers
}

/// Compiles the text with the host's words, runs it on one tile, and returns each class as it is afterwards.
fn run_cxx(case: &Case, samples: &[Sample]) -> BTreeMap<Class, Vec<f32>> {
    run_cxx_with(case, samples, "")
}

/// As [`run_cxx`], with a line before the text.
fn run_cxx_with(case: &Case, samples: &[Sample], line: &str) -> BTreeMap<Class, Vec<f32>> {
    let folder = tempfile::tempdir().unwrap();
    let words = include_str!("../common/host.hpp");
    let mut text = line.to_owned() + &head(&case.layout, 64) + words + &body(&case.program, &case.layout);
    text.push_str("#include <cstdio>\nint main() {\n");
    for (name, table) in tables(&case.period.graph) {
        let numbers: Vec<u8> = table.iter().flat_map(|&number| (number as f32).to_ne_bytes()).collect();
        std::fs::write(folder.path().join(&name), numbers).unwrap();
        writeln!(text, "std::fread({name}, 4, {}, std::fopen(\"{name}\", \"rb\"));", table.len()).unwrap();
    }
    let mut count = 0;
    for class in Class::ALL {
        let size = length(case, class).max(1);
        writeln!(text, "static float c{}[{size}];", class as usize).unwrap();
        writeln!(
            text,
            "if (std::fread(c{0}, 4, {1}, stdin) != {1}) return 1;",
            class as usize,
            length(case, class)
        )
        .unwrap();
        count += length(case, class);
    }
    let count_of = case.layout.environments();
    writeln!(text, "for (environment = 0; environment < {count_of}; ++environment)").unwrap();
    text.push_str("control_period(c0, c1, c2, c3, c4, c5, c6, 1);\n");
    for class in Class::ALL {
        writeln!(text, "std::fwrite(c{}, 4, {}, stdout);", class as usize, length(case, class)).unwrap();
    }
    text.push_str("}\n");
    let (source, binary) = (folder.path().join("period.cpp"), folder.path().join("period"));
    std::fs::write(&source, text).unwrap();
    // Optimised, the long functions take the compiler five times as long; the numbers are the same.
    let made = Command::new("g++")
        .args(["-O0", "-w", "-Wno-psabi", "-o"])
        .args([&binary, &source])
        .output()
        .unwrap();
    assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
    let input: Vec<u8> =
        Class::ALL.iter().flat_map(|&class| tile(case, class, samples)).flat_map(f32::to_ne_bytes).collect();
    let given = folder.path().join("in");
    std::fs::write(&given, &input).unwrap();
    let output = Command::new(&binary)
        .current_dir(folder.path())
        .stdin(std::fs::File::open(&given).unwrap())
        .output()
        .unwrap();
    assert!(output.status.success());
    let numbers: Vec<f32> =
        output.stdout.as_chunks::<4>().0.iter().map(|bytes| f32::from_ne_bytes(*bytes)).collect();
    assert_eq!(numbers.len(), count);
    let mut rest = numbers.as_slice();
    let mut classes = BTreeMap::new();
    for class in Class::ALL {
        let (own, others) = rest.split_at(length(case, class));
        classes.insert(class, own.to_vec());
        rest = others;
    }
    classes
}

/// Largest error of velocities (m/s, rad/s) and of everything else but accelerations.
fn errors(case: &Case, classes: &BTreeMap<Class, Vec<f32>>, samples: &[Sample]) -> (f64, f64) {
    let (mut velocity, mut other) = (0.0f64, 0.0f64);
    // Every third number of a gear is an acceleration.
    let gears = case.period.inputs.iter().find_map(|input| match input {
        Input::Memory { index, zero: true, .. } => Some(*index),
        _ => None,
    });
    let is_acceleration =
        |place: usize| gears.is_some_and(|first| place >= first && (place - first) % 3 == 2);
    for (environment, sample) in samples.iter().enumerate() {
        for ((output, place), want) in
            case.period.outputs.iter().zip(&case.layout.outputs).zip(&sample.outputs)
        {
            let got = f64::from(classes[&place.class][case.layout.offset(*place, environment)]);
            let error = (got - want).abs();
            let error = if error.is_nan() { f64::INFINITY } else { error };
            match output {
                Output::State(slot) if matches!(slot.name, "qvel" | "linear" | "angular") => {
                    velocity = velocity.max(error)
                }
                Output::State(slot) if matches!(slot.name, "qacc" | "acceleration") => {}
                Output::Memory(place) if is_acceleration(*place) => {}
                // What networks and gears remember: angles and velocities.
                Output::Memory(_) => velocity = velocity.max(error),
                Output::Report(slot) if slot.name == "place" => other = other.max(error),
                // Contacts are stiff: an error of the velocity over a step is a force.
                Output::Report(_) => velocity = velocity.max(error / (1.0 + want.abs()) / 20.0),
                Output::State(_) | Output::Target { .. } => other = other.max(error),
            }
        }
    }
    (velocity, other)
}

fn check_cxx(label: &str, model: &Model, preset: Preset, lanes: usize, min_guarded: usize, networks: bool) {
    let case = case(model, preset, lanes, min_guarded, networks);
    let count = case.layout.environments().min(8);
    let samples = samples(model, &settings(model, preset), TAPS, SUBSTEPS, networks, true, count);
    let classes = run_cxx(&case, &samples);
    let (velocity, other) = errors(&case, &classes, &samples);
    println!("{label}, {preset:?}, {lanes} lanes: velocities off by {velocity:.1e}, positions {other:.1e}");
    // Elliptic contacts slip one way or another by the last bits of their residuals. A field's normals are those of
    // small triangles.
    let field = model.obstacles.iter().any(|obstacle| matches!(obstacle.shape, ObstacleShape::Field(_)));
    let most = match model.options.cone {
        Cone::Elliptic => 1e-2,
        _ if field => 1e-3,
        _ => 3e-4,
    };
    assert!(velocity < most && other < 0.01 * most + 3e-6, "{velocity} {other}");
}

/// A change of the step or of the emitter changes the text: `GAITFIT_UPDATE_GOLDEN=1` writes the file anew, and its
/// difference says how much work the step has become.
#[test]
fn the_text_of_the_go2_is_known() {
    let case = case(&feet(robot("go2")), Preset::Fast, 4, 600, false);
    let program = &case.program.program;
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    for node in &program.nodes {
        let name = format!("{:?}", node.op);
        *counts.entry(name.split('(').next().unwrap_or_default().to_owned()).or_default() += 1;
    }
    let mut summary = String::new();
    for (name, count) in counts {
        writeln!(summary, "{name} {count}").unwrap();
    }
    let text = cuda(&case.program, &case.layout, 64);
    writeln!(summary, "regions {}, table rows {}", program.regions.len(), program.table.len()).unwrap();
    let digest: String =
        Sha256::digest(&text).iter().fold(String::new(), |hex, byte| format!("{hex}{byte:02x}"));
    writeln!(summary, "text {} bytes, sha256 {digest}", text.len()).unwrap();
    let path = format!("{}/tests/golden/go2_feet.txt", env!("CARGO_MANIFEST_DIR"));
    if std::env::var_os("GAITFIT_UPDATE_GOLDEN").is_some() {
        std::fs::write(&path, &summary).unwrap();
    }
    assert_eq!(summary, std::fs::read_to_string(&path).unwrap());
}

#[test]
#[ignore = "needs g++"]
fn cxx_text_computes_the_step() {
    let go2 = robot("go2");
    check_cxx("go2 feet", &feet(go2.clone()), Preset::Fast, 4, usize::MAX, false);
    check_cxx("telescope", &robot("telescope"), Preset::Fast, 2, 300, false);
    check_cxx("hand", &robot("hand"), Preset::Fast, 1, 300, false);
    check_cxx("gears", &robot("gears"), Preset::Fast, 1, 300, false);
}

#[test]
#[ignore = "needs g++"]
fn long_cxx_text_computes_the_step_of_other_robots() {
    let go2 = robot("go2");
    check_cxx("go2", &go2, Preset::Fast, 4, 300, true);
    check_cxx("go2 feet", &feet(go2.clone()), Preset::Accurate, 2, 0, false);
    check_cxx("go2 feet", &feet(go2.clone()), Preset::Fast, 1, 100, true);
    check_cxx("humanoid", &robot("humanoid"), Preset::Fast, 2, 100, false);
    check_cxx("go2 feet on a field", &on_field(feet(go2.clone())), Preset::Fast, 4, 600, false);
    check_cxx("go2 feet on a box", &on_box(feet(go2.clone())), Preset::Fast, 2, 0, true);
    // The text of all pairs of its file has 3.7 MB, which takes the compiler as long as all other texts. So: one pair of each
    // two kinds of shapes, and of those that the file states.
    let pairs = [
        ["FL_foot", "FR_foot"],
        ["RL_knee", "RR_knee"],
        ["FL_shank", "FR_shank"],
        ["FR_shank", "RR_foot"],
        ["trunk", "RL_foot"],
    ];
    let pairs = pairs.map(|pair| pair.map(str::to_owned)).to_vec();
    let crab = touching(&robot("crab"), &SelfContact::Pairs(pairs));
    check_cxx("crab that touches itself", &crab, Preset::Fast, 1, 600, false);
    check_cxx("dragged tripod", &robot("drag"), Preset::Fast, 1, 600, false);
    let mut elliptic = feet(go2);
    elliptic.options.cone = Cone::Elliptic;
    check_cxx("elliptic go2 feet", &elliptic, Preset::Fast, 4, 600, false);
}

/// Robots in the air leave out all guarded regions: the shorter of a loop's two texts gives the numbers of the other.
#[test]
#[ignore = "needs g++"]
fn cxx_both_texts_of_a_loop_have_the_same_numbers() {
    for (label, preset, least) in [("fast", Preset::Fast, 600), ("accurate", Preset::Accurate, 100)] {
        let model = robot("go2");
        let case = case(&model, preset, 4, least, true);
        let mut samples = samples(&model, &settings(&model, preset), TAPS, SUBSTEPS, true, true, 8);
        // Every other robot a metre higher.
        samples.iter_mut().step_by(2).for_each(|sample| sample.inputs[2] += 1.0);
        let outputs = run_cxx(&case, &samples);
        let wanted = run_cxx_with(&case, &samples, "#define EVERY_REGION\n");
        let mut numbers = 0;
        for (class, wanted) in &wanted {
            for (got, want) in outputs[class].iter().zip(wanted).filter(|(_, want)| !want.is_nan()) {
                assert!(got == want, "{label}: {got} and {want} of {class:?}");
                numbers += 1;
            }
        }
        let text = body(&case.program, &case.layout);
        assert_eq!(text.matches("} else {").count(), 1, "{label}");
        assert!(numbers > 500, "{label}: {numbers}");
    }
}

#[test]
#[ignore = "needs NVRTC: tools/setup_nvrtc.sh"]
fn nvrtc_compiles_the_text() {
    let go2 = robot("go2");
    let feet = feet(go2.clone());
    let humanoid = robot("humanoid");
    let cases = [
        ("go2 feet, fast, 4 lanes, flat", case(&feet, Preset::Fast, 4, usize::MAX, false)),
        ("go2 feet, fast, 4 lanes", case(&feet, Preset::Fast, 4, 100, false)),
        ("go2 feet, fast, 2 lanes, flat", case(&feet, Preset::Fast, 2, usize::MAX, false)),
        ("go2 feet, accurate, 4 lanes, flat", case(&feet, Preset::Accurate, 4, usize::MAX, false)),
        ("go2, fast, 4 lanes", case(&go2, Preset::Fast, 4, 600, false)),
        ("go2, fast, 2 lanes", case(&go2, Preset::Fast, 2, 100, false)),
        ("go2 feet, fast, 4 lanes, networks", case(&feet, Preset::Fast, 4, 100, true)),
        ("go2 feet on a field, fast, 4 lanes", case(&on_field(feet.clone()), Preset::Fast, 4, 600, false)),
        ("go2 on a field, fast, 4 lanes", case(&on_field(go2.clone()), Preset::Fast, 4, 600, false)),
        ("humanoid, fast, 2 lanes", case(&humanoid, Preset::Fast, 2, 100, false)),
    ];
    for (label, case) in cases {
        let text = cuda(&case.program, &case.layout, 64);
        if let Some(folder) = std::env::var_os("GAITFIT_KEEP_TEXT") {
            let name = label.replace([' ', ','], "_");
            std::fs::write(std::path::Path::new(&folder).join(format!("{name}.cu")), &text).unwrap();
        }
        let program = Program::new("control_period", text).option("-ftz=true").option("-fmad=false");
        let program = program.option("--ptxas-options=-v");
        let start = std::time::Instant::now();
        let compiled = compile(Nvrtc::get().unwrap(), &program, (9, 0), None).unwrap();
        let seconds = start.elapsed().as_secs_f64();
        let words =
            compiled.image.log.lines().filter(|line| line.contains("registers") || line.contains("spill"));
        let words: Vec<&str> = words.map(|line| line.trim()).collect();
        println!("{label}: {seconds:.1} s, {} bytes, {}", compiled.image.code.len(), words.join("; "));
        assert!(seconds < 30.0, "{label} takes {seconds} s");
    }
}
