//! Hostile files end in an error, never in a panic, an overflow of the stack, or runaway memory.
#![allow(clippy::unwrap_used, reason = "a test stops at the first surprise")]

use std::path::{Path, PathBuf};

use gaitfit_model::{Ground, ModelError, ReadOptions, Root, read, read_mjcf_str, read_urdf_str};

fn here(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(path)
}

const LENIENT: ReadOptions =
    ReadOptions { lenient: true, root: Some(Root::Fixed), add_floor: false, in_the_air: false, mend: false };

fn strict(text: &str) -> ModelError {
    read_mjcf_str(text, &ReadOptions::default()).unwrap_err()
}

#[test]
fn deep_wide_and_long_files_are_too_large() {
    for depth in [101, 100_000] {
        let deep = format!(
            "<mujoco><worldbody>{}{}</worldbody></mujoco>",
            "<body>".repeat(depth),
            "</body>".repeat(depth)
        );
        assert!(matches!(strict(&deep), ModelError::TooLarge { .. }), "{depth}");
    }
    let leg = "<body><joint/><geom size='1'/></body>";
    for (what, text) in [
        ("bodies", format!("<mujoco><worldbody><body>{}</body></worldbody></mujoco>", leg.repeat(300))),
        ("nodes", format!("<mujoco>{}</mujoco>", "<size/>".repeat(250_000))),
        ("MiB", format!("<mujoco>{}</mujoco>", " ".repeat(17 << 20))),
        ("classes", {
            let classes: String = (0..600).map(|i| format!("<default class='c{i}'/>")).collect();
            format!("<mujoco><default>{classes}</default></mujoco>")
        }),
        ("pairs", {
            let planes = "<geom type='plane'/>".repeat(100);
            let geoms = "<geom size='1'/>".repeat(100);
            format!("<mujoco><worldbody>{planes}<body><joint/>{geoms}</body></worldbody></mujoco>")
        }),
    ] {
        let error = strict(&text);
        assert!(matches!(error, ModelError::TooLarge { .. }), "{what}: {error}");
        assert!(error.to_string().contains(what), "{error}");
    }
    let unknown = format!("<mujoco>{}</mujoco>", "<x/>".repeat(3000));
    assert!(matches!(read_mjcf_str(&unknown, &LENIENT), Err(ModelError::TooLarge { .. })));
    let links: String = (0..400).map(|i| format!("<link name='l{i}'/>")).collect();
    let error = read_urdf_str(&format!("<robot>{links}</robot>"), &LENIENT).unwrap_err();
    assert!(matches!(error, ModelError::TooLarge { .. }), "{error}");
}

#[test]
fn document_types_and_entities_are_refused() {
    let bomb = "<!DOCTYPE m [<!ENTITY a \"aaaa\"><!ENTITY b \"&a;&a;\">]><mujoco model=\"&b;\"/>";
    assert!(matches!(strict(bomb), ModelError::Syntax { .. }));
}

#[test]
fn includes_are_bounded_and_acyclic() {
    let folder = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        std::fs::write(folder.path().join(name), text).unwrap();
        folder.path().join(name)
    };
    let fails = |path: &Path| read(path, &ReadOptions::default()).unwrap_err().to_string();
    write("b.xml", "<mujoco><include file=\"a.xml\"/></mujoco>");
    let a = write("a.xml", "<mujoco><include file=\"b.xml\"/></mujoco>");
    assert!(fails(&a).contains("includes itself"), "{}", fails(&a));
    let own = write("own.xml", "<mujoco><include file=\"./own.xml\"/></mujoco>");
    assert!(fails(&own).contains("includes itself"));
    write("part.xml", "<mujocoinclude><size/></mujocoinclude>");
    let twice =
        write("twice.xml", "<mujoco><include file=\"part.xml\"/><include file=\"part.xml\"/></mujoco>");
    assert!(fails(&twice).contains("included twice"));
    let missing = write("missing.xml", "<mujoco>\n <include file=\"nowhere.xml\"/></mujoco>");
    assert!(fails(&missing).contains("missing.xml:2:2: cannot include"), "{}", fails(&missing));
    let directory = write("directory.xml", "<mujoco><include file=\".\"/></mujoco>");
    assert!(fails(&directory).contains("not a regular file"), "{}", fails(&directory));
    for i in 0..70 {
        write(&format!("c{i}.xml"), &format!("<m><include file=\"c{}.xml\"/></m>", i + 1));
    }
    let chain = write("chain.xml", "<mujoco><include file=\"c0.xml\"/></mujoco>");
    assert!(fails(&chain).contains("more than 64 files"), "{}", fails(&chain));
    // Depth adds up over files.
    write("deep.xml", &format!("<m>{}{}</m>", "<body>".repeat(90), "</body>".repeat(90)));
    let nested = format!(
        "<mujoco><worldbody>{}<include file=\"deep.xml\"/>{}</worldbody></mujoco>",
        "<body>".repeat(90),
        "</body>".repeat(90)
    );
    let nested = write("nested.xml", &nested);
    assert!(fails(&nested).contains("deeper than"), "{}", fails(&nested));
    std::fs::write(folder.path().join("latin.xml"), b"<mujoco>\n<a b=\"\xe9\"/></mujoco>").unwrap();
    assert!(fails(&folder.path().join("latin.xml")).contains("latin.xml:2:7: the file is not UTF-8"));
}

/// Small deterministic generator (xorshift64*), so that a failure repeats.
struct Random(u64);

impl Random {
    fn below(&mut self, bound: usize) -> usize {
        self.0 ^= self.0 >> 12;
        self.0 ^= self.0 << 25;
        self.0 ^= self.0 >> 27;
        (self.0.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 33) as usize % bound
    }
}

/// Breaks a text in a few places: bytes, numbers, words, and whole pieces moved or repeated.
fn mutate(text: &str, random: &mut Random) -> String {
    const WORDS: [&str; 16] = [
        "nan",
        "-1",
        "1e308",
        "-1e-308",
        "0",
        "1 2 3 4 5 6 7 8",
        "",
        "inf",
        "\"",
        "<",
        "/>",
        "true",
        "<body>",
        "</body>",
        "plane",
        "4294967296",
    ];
    let mut bytes = text.as_bytes().to_vec();
    for _ in 0..=random.below(4) {
        let at = random.below(bytes.len());
        match random.below(4) {
            0 => bytes[at] = b" 0123456789.-eE<>/\"=abcdefxyz"[random.below(29)],
            1 => {
                let word = WORDS[random.below(WORDS.len())].as_bytes();
                // Replace the contents of the next quoted value: the deepest way into the readers.
                let open = bytes[at..].iter().position(|b| *b == b'"').map_or(at, |i| at + i + 1);
                let close = bytes[open..].iter().position(|b| *b == b'"').map_or(open, |i| open + i);
                bytes.splice(open..close, word.iter().copied());
            }
            2 => {
                let end = (at + random.below(200)).min(bytes.len());
                bytes.drain(at..end);
            }
            _ => {
                let end = (at + random.below(400)).min(bytes.len());
                let piece = bytes[at..end].to_vec();
                let to = random.below(bytes.len());
                bytes.splice(to..to, piece);
            }
        }
        if bytes.is_empty() {
            bytes.push(b'<');
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[test]
fn mutated_robots_never_panic() {
    let mut random = Random(0x9E37_79B9_7F4A_7C15);
    let (mut accepted, mut refused) = (0, 0);
    for (path, rounds) in [
        ("../../assets/go2.xml", 1500),
        ("tests/robots/humanoid.xml", 1500),
        ("tests/robots/arm.xml", 1500),
        ("../../assets/go2.urdf", 1000),
    ] {
        let text = std::fs::read_to_string(here(path)).unwrap();
        for round in 0..rounds {
            let broken = mutate(&text, &mut random);
            let options = ReadOptions {
                lenient: round % 2 == 0,
                root: [None, Some(Root::Fixed), Some(Root::Floating)][round % 3],
                add_floor: round % 5 < 2,
                in_the_air: round % 11 < 5,
                mend: round % 7 < 3,
            };
            let result = if path.ends_with("urdf") {
                read_urdf_str(&broken, &options)
            } else {
                read_mjcf_str(&broken, &options)
            };
            match result {
                Ok(model) => {
                    accepted += 1;
                    assert!(model.bodies.iter().all(|b| b.mass.is_finite() && b.mass >= 0.0));
                    assert!(model.pairs.iter().all(|p| p.geom < model.geoms.len()
                        && match p.ground {
                            Ground::Plane(plane) => plane < model.planes.len(),
                            Ground::Obstacle { obstacle } => obstacle < model.obstacles.len(),
                        }));
                    assert!(model.actuators.iter().all(|a| a.joint < model.joints.len()));
                    let _ = model.summary();
                }
                Err(error) => {
                    refused += 1;
                    assert!(error.place().is_some_and(|p| p.line >= 1 && p.column >= 1));
                    assert!(error.to_string().len() < 2000, "{error}");
                }
            }
        }
    }
    assert!(accepted > 100 && refused > 1000, "{accepted} accepted, {refused} refused");
}

#[test]
fn names_cannot_command_a_terminal() {
    for (name, said) in [("a&#x9b;2J", "a\\u{9b}2J"), ("a&#10;b", "a\\nb"), ("a\u{202e}b", "a\\u{202e}b")] {
        let robot = format!(
            "<mujoco><worldbody><body><freejoint/><geom size='1'/><body><joint name='{name}'/><geom size='1'/></body>\
             </body></worldbody></mujoco>"
        );
        let error = strict(&robot).to_string();
        assert!(error.contains("control characters") && error.contains(said), "{error}");
        let unknown = strict(&format!("<mujoco><option integrator='{name}'/></mujoco>")).to_string();
        assert!(unknown.contains(said), "{unknown}");
    }
    let long = format!("<mujoco model='{}'/>", "m".repeat(5000));
    assert!(strict(&long).to_string().len() < 300, "{}", strict(&long));
    let huge = format!("<mujoco><option timestep='-1{}'/></mujoco>", "0".repeat(300));
    assert!(strict(&huge).to_string().contains("is -1e300;"), "{}", strict(&huge));
    let unclosed = format!("<mujoco><{0}></{0}b></mujoco>", "\u{4e00}".repeat(80));
    assert!(strict(&unclosed).to_string().chars().count() < 320, "{}", strict(&unclosed));
}
