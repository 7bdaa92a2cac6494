//! Runs a plan on the CPU: the kernels' text compiled as C++ with `shim.hpp`.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::collections::HashMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::Command;

use gaitfit_cuda::ppo::{Array, Id, Launch, Plan, Value};
use gaitfit_cuda::runtime::Program;
use sha2::{Digest, Sha256};

/// Arrays by name, as bytes.
pub type Arrays = HashMap<&'static str, Vec<u8>>;

/// Bytes of numbers.
pub fn bytes<const N: usize, T: Copy>(numbers: &[T], to: fn(T) -> [u8; N]) -> Vec<u8> {
    numbers.iter().flat_map(|&number| to(number)).collect()
}

/// The numbers of an `f32` array.
#[allow(dead_code, reason = "not every test has such arrays")]
pub fn floats(bytes: &[u8]) -> Vec<f32> {
    bytes.chunks_exact(4).map(|b| f32::from_ne_bytes(b.try_into().unwrap())).collect()
}

/// The numbers of an `f64` array.
#[allow(dead_code, reason = "not every test has such arrays")]
pub fn doubles(bytes: &[u8]) -> Vec<f64> {
    bytes.chunks_exact(8).map(|b| f64::from_ne_bytes(b.try_into().unwrap())).collect()
}

/// Runs `plan.pack` and the plan's launches, starting from `arrays`; those that are not given are 0 if in `zeros`, else no
/// numbers. Gives all arrays afterwards.
#[allow(dead_code, reason = "not every test has a plan")]
pub fn run(text: &str, plan: &Plan, arrays: &Arrays, zeros: &[&str]) -> Arrays {
    let mut statements = String::new();
    for launch in plan.pack.iter().chain(&plan.launches) {
        statements.push_str(&call(launch));
    }
    for array in &plan.arrays {
        writeln!(statements, "    {}", keep(&plan.arrays, array.name, "out")).unwrap();
    }
    let files = arrays.iter().map(|(name, bytes)| {
        assert!(plan.array(name).is_some(), "the plan has no array {name}");
        (name.to_string(), bytes.clone())
    });
    let folder = execute(text, &plan.arrays, &files.collect(), zeros, &statements);
    let read = |name: &str| std::fs::read(folder.path().join(format!("{name}.out"))).unwrap();
    plan.arrays.iter().map(|array| (array.name, read(array.name))).collect()
}

/// As [`run`], the plans of all GPUs of a training, in order: between their parts each takes what the others say. The plans have
/// the same text.
pub fn run_together(text: &str, plans: &[&Plan], arrays: &[Arrays], zeros: &[&str]) -> Vec<Arrays> {
    let name = |name: &str, number: usize| -> &'static str { format!("{name}.{number}").leak() };
    let (mut all, mut files, mut statements) = (Vec::new(), HashMap::new(), String::new());
    let mut firsts = Vec::new();
    for (number, (plan, arrays)) in plans.iter().zip(arrays).enumerate() {
        firsts.push(all.len());
        all.extend(plan.arrays.iter().map(|array| Array { name: name(array.name, number), ..array.clone() }));
        files.extend(arrays.iter().map(|(array, bytes)| (name(array, number).to_owned(), bytes.clone())));
    }
    let moved = |launch: &Launch, first: usize| {
        let value = |value: &Value| match *value {
            Value::Array(Id(number)) => Value::Array(Id(first + number)),
            other => other,
        };
        call(&Launch { arguments: launch.arguments.iter().map(value).collect(), ..launch.clone() })
    };
    for (plan, &first) in plans.iter().zip(&firsts) {
        plan.pack.iter().for_each(|launch| statements.push_str(&moved(launch, first)));
    }
    for part in 0..plans[0].parts().len() {
        for (plan, &first) in plans.iter().zip(&firsts) {
            let launches = &plan.launches[plan.parts()[part].clone()];
            launches.iter().for_each(|launch| statements.push_str(&moved(launch, first)));
        }
        let Some(exchange) = plans[0].exchanges.get(part) else { continue };
        for &[Id(own), Id(of_all)] in &exchange.arrays {
            let bytes = plans[0].arrays[own].bytes();
            assert_eq!(plans[0].arrays[of_all].bytes(), plans.len() as u64 * bytes);
            for to in &firsts {
                for (number, from) in firsts.iter().enumerate() {
                    let (to, from) = (to + of_all, from + own);
                    writeln!(
                        statements,
                        "    memcpy(all[{to}].data() + {number} * {bytes}, all[{from}].data(), {bytes});"
                    )
                    .unwrap();
                }
            }
        }
    }
    for array in &all {
        writeln!(statements, "    {}", keep(&all, array.name, "out")).unwrap();
    }
    let zeros: Vec<&str> =
        (0..plans.len()).flat_map(|number| zeros.iter().map(move |zero| name(zero, number))).collect();
    let folder = execute(text, &all, &files, &zeros, &statements);
    let read = |name: &str| std::fs::read(folder.path().join(format!("{name}.out"))).unwrap();
    let of = |(number, plan): (usize, &&Plan)| {
        plan.arrays.iter().map(|array| (array.name, read(name(array.name, number)))).collect()
    };
    plans.iter().enumerate().map(of).collect()
}

/// The C++ statement that writes an array into the file `name.suffix`.
pub fn keep(arrays: &[Array], name: &str, suffix: &str) -> String {
    let number = arrays.iter().position(|array| array.name == name).unwrap();
    format!("store(\"{name}.{suffix}\", all[{number}]);")
}

/// The C++ statements that fill a program's tables, whose files join `files`.
#[allow(dead_code, reason = "not every test has tables")]
pub fn fill(program: &Program, files: &mut HashMap<String, Vec<u8>>) -> String {
    let mut statements = String::new();
    for (name, numbers) in &program.tables {
        files.insert(name.clone(), bytes(numbers, f32::to_ne_bytes));
        writeln!(statements, "    fill(\"{name}\", {name}, sizeof {name});").unwrap();
    }
    statements
}

/// The C++ statement that reads an array from the file `name.suffix`.
#[allow(dead_code, reason = "not every test needs it")]
pub fn take(arrays: &[Array], name: &str, suffix: &str) -> String {
    let number = arrays.iter().position(|array| array.name == name).unwrap();
    format!("load(\"{name}.{suffix}\", all[{number}]);")
}

/// The program of a C++ text. Several tests run the same one, which is compiled once.
fn built(source: &str) -> PathBuf {
    let digest: String =
        Sha256::digest(source).iter().fold(String::new(), |all, byte| format!("{all}{byte:02x}"));
    let programs = Path::new(env!("CARGO_TARGET_TMPDIR")).join("cxx");
    std::fs::create_dir_all(&programs).unwrap();
    let program = programs.join(digest);
    if !program.exists() {
        let folder = tempfile::tempdir_in(&programs).unwrap();
        std::fs::write(folder.path().join("main.cpp"), source).unwrap();
        let made = Command::new("g++")
            .args([
                "-std=c++17",
                "-O1",
                "-w",
                "-U_FORTIFY_SOURCE",
                "-ffp-contract=off",
                "-o",
                "main",
                "main.cpp",
            ])
            .current_dir(folder.path())
            .output()
            .unwrap();
        assert!(made.status.success(), "{}", String::from_utf8_lossy(&made.stderr));
        // Renamed when it is whole: another test may look for it at the same time.
        std::fs::rename(folder.path().join("main"), &program).unwrap();
    }
    program
}

/// Compiles `text` with a program of `statements` and runs it in a folder with these files. Arrays are read from the file
/// of their name, if there is one; others are 0 if in `zeros`, else no numbers.
pub fn execute(
    text: &str,
    arrays: &[Array],
    files: &HashMap<String, Vec<u8>>,
    zeros: &[&str],
    statements: &str,
) -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    for (name, bytes) in files {
        std::fs::write(at(name), bytes).unwrap();
    }
    let mut main = String::from("int main() {\n    std::vector<std::vector<char>> all;\n");
    for array in arrays {
        let fill = if zeros.contains(&array.name) { 0 } else { -1 };
        let (name, bytes) = (array.name, array.bytes());
        writeln!(main, "    all.emplace_back({bytes}, (char){fill}); load(\"{name}\", all.back());").unwrap();
    }
    main.push_str(statements);
    main.push_str("}\n");
    let program = built(&format!("{}\n{text}\n{main}", include_str!("shim.hpp")));
    let ran = Command::new(program).current_dir(folder.path()).output().unwrap();
    assert!(ran.status.success(), "{ran:?}");
    folder
}

/// The C++ statement for one launch.
pub fn call(launch: &Launch) -> String {
    let dim = |[x, y, z]: [u32; 3]| format!("{{{x}, {y}, {z}}}");
    let arguments: Vec<String> = launch
        .arguments
        .iter()
        .map(|value| match value {
            Value::Array(id) => format!("Any{{all[{}].data()}}", id.0),
            Value::U32(word) => format!("{word}u"),
            Value::F32(number) => format!("{number:?}f"),
        })
        .collect();
    format!(
        "    run({}, {}, {}, [&] {{ {}({}); }});\n",
        dim(launch.shape.grid),
        dim(launch.shape.block),
        launch.shape.shared,
        launch.kernel,
        arguments.join(", ")
    )
}
