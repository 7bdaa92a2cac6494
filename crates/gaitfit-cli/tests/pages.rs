//! Every page in a real browser: it complains of nothing, asks for nothing, fits a phone, plays, and shows the numbers of
//! `result.json`.
#![cfg(unix)]
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use crate::chromium;
use crate::common;

use base64::prelude::{BASE64_STANDARD, Engine};
use chromium::{Browser, address};
use common::loops::{SIMULATED, args};
use common::{errors, json, quick_demo, run};
use serde_json::Value;
use std::path::{Path, PathBuf};

/// Where pictures of the pages are kept, to look at them.
const PICTURES: &str = "GAITFIT_PICTURES";
// Widths in CSS pixels: of a phone held upright, and of a window at a desk.
const PHONE: u32 = 390;
const DESK: u32 = 1440;

/// A page and the document of the run that wrote it.
struct Page {
    name: &'static str,
    file: PathBuf,
    result: Value,
}

/// Runs a command that must succeed.
fn done<S: AsRef<std::ffi::OsStr>>(args: &[S]) -> Value {
    let output = run(args);
    assert!(output.status.success(), "{}", errors(&output));
    json(&output)
}

/// One page of each kind, of small runs.
fn pages(folder: &Path) -> Vec<Page> {
    let path = |name: &str| folder.join(name);
    let text = |name: &str| folder.join(name).display().to_string();
    let runs = format!("runs={}", folder.display());
    let small =
        ["train.iterations=2", "train.environments=32", "ppo.actor_hidden=[8]", "ppo.critic_hidden=[8]"];
    let mut training = vec!["train", "--name", "train", "--json", "--seeds", "2", "--set", &runs];
    training.extend(small.iter().flat_map(|set| ["--set", set]));
    let trained = done(&training);
    let fitted = done(&quick_demo(folder, &["--name", "adapt", "--set", "costs=[\"matcho\", \"wass\"]"]));
    let (page, replay) = (text("evaluate.html"), text("replay.html"));
    let policy = "assets/go2-walk.safetensors";
    let flat = ["--trajectories", "16", "--seconds", "1", "--drift", "2", "--json"];
    let evaluated =
        done(&[&["evaluate", policy, "--report", &page, "--replay", &replay][..], &flat].concat());
    let uneven = text("uneven.html");
    let ground = ["--terrain", "stairs", "--terrain-robots", "2", "--report", &uneven];
    let crossed = done(&[&["evaluate", policy][..], &flat, &ground].concat());
    let loops = |name: &str, target: &str| done(&args(folder, target, &["--name", name]));
    let simulated = loops("loop", SIMULATED);
    // The same logs of a robot that is away.
    let absent = format!(
        "logs = [{:?}]\n[target]\nkind = \"command\"\nprobe = [\"false\"]\ncollect = [\"true\", \"{{folder}}\"]\n\
         evaluate = [\"true\"]\n",
        text("loop/round-1/logs")
    );
    let alone = loops("absent", &absent);
    let log = "examples/go2-demo/validate.csv";
    let viewed =
        done(&["view", log, "--theta", &text("adapt/theta.toml"), "--out", &text("view.html"), "--json"]);
    let drawn = done(&["inspect", log, "--plot", &text("plot.html"), "--json"]);
    let compared = done(&["runs", &folder.display().to_string(), "--html", &text("runs.html"), "--json"]);
    let kept = |name, file, result| Page { name, file, result };
    vec![
        kept("view", path("view.html"), viewed),
        kept("plot", path("plot.html"), drawn),
        kept("runs", path("runs.html"), compared),
        kept("train", path("train/report.html"), trained.clone()),
        kept("train-replay", path("train/seed-1/replay.html"), trained),
        kept("adapt", path("adapt/report.html"), fitted),
        kept("evaluate", path("evaluate.html"), evaluated.clone()),
        kept("replay", path("replay.html"), evaluated),
        kept("uneven", path("uneven.html"), crossed),
        kept("loop", path("loop/report.html"), simulated),
        kept("absent", path("absent/report.html"), alone),
    ]
}

#[test]
#[ignore = "needs Chromium"]
fn chromium_shows_every_page_as_it_was_meant() {
    let folder = tempfile::tempdir().unwrap();
    let pages = pages(folder.path());
    let mut browser = Browser::start();
    for page in &pages {
        for (width, dark) in [(DESK, false), (DESK, true), (PHONE, false), (PHONE, true)] {
            let what = format!("{} at {width} px{}", page.name, if dark { ", dark" } else { "" });
            browser.open(&page.file, width, dark);
            looks(&mut browser, &what, width, dark);
            if !dark && browser.value("document.getElementById('player') !== null") == true {
                plays(&mut browser, &what);
            }
            assert!(browser.complaints().is_empty(), "{what}: {:?}", browser.complaints());
            assert_eq!(browser.requests(), [address(&page.file)], "{what} asks for more than itself");
            keep(&mut browser, page.name, width, dark);
        }
        let rows = browser.value(ROWS);
        match page.name {
            "runs" => shows_runs(&rows, &page.result),
            "view" => clock_and_curves_are_joined(&mut browser),
            "train" => shows_training(&rows, &page.result),
            "adapt" => shows_fit(&rows, &page.result),
            "evaluate" | "uneven" => shows_evaluation(&rows, &page.result),
            "loop" | "absent" => shows_loop(&rows, &page.result),
            _ => {}
        }
    }
}

/// All rows of all tables, cell by cell, with plain minus signs and blanks.
const ROWS: &str = r#"[...document.querySelectorAll("tr")].map(row => [...row.cells].map(cell =>
    cell.textContent.replace(/\u2212/g, "-").replace(/\u00a0/g, " ").trim()))"#;

/// Texts that stand on their ground with too little contrast (below 4.5 : 1, large ones 3 : 1; WCAG 2.2, 1.4.3).
const FAINT: &str = r#"(() => {
  const parse = (c) => (c.match(/[\d.]+/g) || []).map(Number);
  const light = (c) => c.slice(0, 3).map(x => x / 255).map(x => x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4)
    .reduce((sum, x, i) => sum + x * [0.2126, 0.7152, 0.0722][i], 0);
  const ground = (e) => {
    for (; e; e = e.parentElement) {
      const c = parse(getComputedStyle(e).backgroundColor);
      if (c.length === 3) { return c; }
      // A veil (the player's read-outs, heat maps) is not judged.
      if (c[3] > 0) { return null; }
    }
    return [255, 255, 255];
  };
  const found = [];
  document.querySelectorAll("main *, header *, nav *").forEach((e) => {
    const own = [...e.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim() !== "");
    if (!own || e.closest("svg, canvas, script, style, noscript, option") || e.getClientRects().length === 0) { return; }
    const style = getComputedStyle(e), below = ground(e);
    if (below === null) { return; }
    const [a, b] = [light(parse(style.color)), light(below)].sort((x, y) => y - x);
    const size = parseFloat(style.fontSize), large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 600);
    const ratio = (a + 0.05) / (b + 0.05);
    if (ratio < (large ? 3 : 4.5)) { found.push(`${ratio.toFixed(2)} ${e.tagName}.${e.className}: ${e.textContent.trim().slice(0, 40)}`); }
  });
  return found;
})()"#;

/// It fits the window, is in the scheme asked for, can be read, and says what its pictures are.
fn looks(browser: &mut Browser, what: &str, width: u32, dark: bool) {
    let wide = browser.value("document.documentElement.scrollWidth").as_u64().unwrap();
    assert!(wide <= u64::from(width), "{what} is {wide} px wide: it scrolls sideways");
    // Nothing sticks out of the window but what a box of its own scrolls.
    let out = browser.value(
        r#"[...document.querySelectorAll("main *, header *")].filter(e => {
            const box = e.getBoundingClientRect();
            return box.width > 0 && box.right > innerWidth + 1 && !e.closest(".scroll, pre, nav, svg, .panes, .tabs");
        }).map(e => e.tagName + "." + e.className + ": " + e.textContent.trim().slice(0, 40)).slice(0, 5)"#,
    );
    assert_eq!(out, serde_json::json!([]), "{what}: outside the window");
    let background = browser.value("getComputedStyle(document.body).backgroundColor");
    // The text is `rgb(r, g, b)`. One channel tells a light ground from a dark one.
    let red: u32 = background.as_str().unwrap()[4..].split(',').next().unwrap().parse().unwrap();
    assert_eq!(red < 100, dark, "{what}: {background}");
    assert_eq!(browser.value(FAINT), serde_json::json!([]), "{what}: too faint");
    assert_eq!(browser.value("document.documentElement.lang"), "en", "{what}");
    assert!(browser.value("document.title").as_str().unwrap().ends_with("– gaitfit"), "{what}");
    let unnamed = "[...document.querySelectorAll('svg:not([aria-hidden]), canvas, input, select')].filter(e => \
                   !(e.getAttribute('aria-label') || (e.labels && e.labels.length))).length";
    assert_eq!(browser.value(unnamed), 0, "{what}: pictures or controls without a name");
    let unreachable = "[...document.querySelectorAll('.scroll')].filter(e => e.checkVisibility() && \
                       e.clientWidth > 0 && e.scrollWidth > e.clientWidth + 1 && e.tabIndex < 0 && !e.querySelector('a, button, input')).length";
    assert_eq!(browser.value(unreachable), 0, "{what}: boxes that the keyboard cannot scroll");
}

/// The time the replay stands at, s.
const TIME: &str = "parseFloat(document.getElementById('clock').textContent)";

/// The replay moves by itself, halts, and is sought by slider and keyboard; what it draws changes with the time.
fn plays(browser: &mut Browser, what: &str) {
    browser
        .value("document.getElementById('player').scrollIntoView({ behavior: 'instant', block: 'center' })");
    browser.until(&format!("{TIME} > 0.05"));
    browser.value("document.getElementById('play').click()");
    let halted = browser.value(TIME);
    std::thread::sleep(std::time::Duration::from_millis(200));
    assert_eq!(browser.value(TIME), halted, "{what}: it halts");
    let mut seek = |share: f64| {
        // What is drawn can be read in the frame in which it is drawn.
        let sought = browser.value(&format!(
            "new Promise(done => {{ const s = document.getElementById('time'); s.value = s.max * {share}; \
             s.dispatchEvent(new Event('input')); \
             requestAnimationFrame(() => done([s.value, document.getElementById('scene').toDataURL()])); }})"
        ));
        let to: f64 = sought[0].as_str().unwrap().parse().unwrap();
        browser.until(&format!("Math.abs({TIME} - {to}) < 0.011"));
        (to, sought[1].clone())
    };
    let (_, before) = seek(0.1);
    let (to, after) = seek(0.7);
    assert!(before != after, "{what}: the picture stays as it was");
    browser.value("document.getElementById('player').focus()");
    browser.press("ArrowLeft");
    browser.until(&format!("{TIME} < {to} && {TIME} > {to} - 0.1"));
    browser.press("Home");
    browser.until(&format!("{TIME} === 0"));
    browser.press(" ");
    browser.until(&format!("{TIME} > 0.05"));
    browser.value("scrollTo(0, 0)");
}

/// Keeps a picture of the page, if a folder for them is named.
fn keep(browser: &mut Browser, name: &str, width: u32, dark: bool) {
    let Some(folder) = std::env::var_os(PICTURES) else { return };
    let name = format!("{name}-{width}-{}.png", if dark { "dark" } else { "light" });
    let picture = BASE64_STANDARD.decode(browser.picture()).unwrap();
    std::fs::write(Path::new(&folder).join(name), picture).unwrap();
}

/// The row whose first cells are these.
fn row<'a>(rows: &'a Value, first: &[&str]) -> Vec<&'a str> {
    let cells = |row: &'a Value| -> Vec<&'a str> {
        row.as_array().unwrap().iter().map(|cell| cell.as_str().unwrap()).collect()
    };
    let mut all = rows.as_array().unwrap().iter().map(cells);
    all.find(|cells| cells.starts_with(first)).unwrap_or_else(|| panic!("no row {first:?} in {rows}"))
}

/// Asserts that a cell's first number is `value`, rounded as it is written.
fn shows(cell: &str, value: &Value, what: &str) {
    let value = value.as_f64().unwrap_or_else(|| panic!("{what} is {value}"));
    let number = cell.split([' ', '%']).next().unwrap();
    let shown: f64 = number.parse().unwrap_or_else(|_| panic!("{what}: `{cell}` begins with no number"));
    let decimals = number.split_once('.').map_or(0, |(_, fraction)| fraction.len() as i32);
    // Very small and very large numbers are written as 1.2 × 10⁻⁵.
    let power: i32 = match cell.split_once("× 10") {
        None => 0,
        Some((_, power)) => {
            let digit = |c| "⁰¹²³⁴⁵⁶⁷⁸⁹".chars().position(|d| d == c).map(|d| d.to_string());
            let text: String =
                power.chars().map(|c| if c == '⁻' { "-".to_owned() } else { digit(c).unwrap() }).collect();
            text.parse().unwrap()
        }
    };
    let scale = 10f64.powi(power);
    let apart = (shown * scale - value).abs();
    // Half of the last digit, and a little more for the rounding of this comparison.
    assert!(apart <= 0.5001 * scale * 10f64.powi(-decimals), "{what}: {cell}, not {value}");
}

fn percent(share: &Value) -> Value {
    (100.0 * share.as_f64().unwrap()).into()
}

/// A click on a curve sets the clock, and every curve shows its time.
fn clock_and_curves_are_joined(browser: &mut Browser) {
    browser.value(
        "(() => { const svg = document.querySelector('#curves svg[role=img]'); const b = svg.getBoundingClientRect(); \
         svg.dispatchEvent(new PointerEvent('pointerdown', { clientX: b.left + 0.5 * b.width, clientY: b.top + 20 })); })()",
    );
    browser.until(&format!("{TIME} > 3 && {TIME} < 5"));
    let lines =
        "new Set([...document.querySelectorAll('#curves .now')].map(line => line.getAttribute('x1'))).size";
    assert_eq!(browser.value(lines), 1, "all curves show one time");
    assert_eq!(browser.value("document.querySelectorAll('#curves .now').length"), 24, "two panels a joint");
}

fn shows_runs(rows: &Value, result: &Value) {
    let fit = result.as_array().unwrap().iter().find(|run| run["kind"] == "fit").unwrap();
    for parameter in fit["parameters"].as_array().unwrap() {
        let name = parameter["name"].as_str().unwrap();
        let cells = row(rows, &[name]);
        assert!(cells[2..].iter().any(|cell| *cell != "–"), "{name}: {cells:?}");
    }
}

fn shows_training(rows: &Value, result: &Value) {
    for seed in result["seeds"].as_array().unwrap() {
        let cells = row(rows, &[&seed["seed"].to_string()]);
        shows(cells[2], &seed["linear_velocity_error"], "linear error");
        shows(cells[3], &seed["angular_velocity_error"], "angular error");
        shows(cells[5], &seed["iterations"], "iterations");
    }
}

fn shows_fit(rows: &Value, result: &Value) {
    let parameters = result["fits"][0]["parameters"].as_array().unwrap();
    assert!(parameters.len() > 5);
    for parameter in parameters {
        let name = parameter["name"].as_str().unwrap();
        let cells = row(rows, &[name]);
        shows(cells[1], &parameter["value"], name);
        // The truth stands beside it.
        shows(cells[2], &parameter["truth"], name);
        // The longer side of the interval, never what runs of the optimiser differ by.
        if let (Some(value), Some(ends)) = (parameter["value"].as_f64(), parameter["interval"].as_array()) {
            let end = |at: usize| ends[at].as_f64().unwrap();
            shows(cells[3], &Value::from((value - end(0)).max(end(1) - value)), name);
        }
    }
    let fitted = row(rows, &["fitted simulator"]);
    shows(fitted.last().unwrap(), &result["cost"], "cost");
}

fn shows_evaluation(rows: &Value, result: &Value) {
    for (name, key) in [
        ("summed reward", "reward"),
        ("linear-velocity error", "linear_velocity_error"),
        ("angular-velocity error", "angular_velocity_error"),
        ("action rate", "action_rate"),
    ] {
        shows(row(rows, &[name])[1], &result[key]["mean"], name);
    }
    for trial in result["drift"].as_array().unwrap() {
        let [x, y, yaw] = [0, 1, 2].map(|k| trial["command"][k].as_f64().unwrap());
        let unit = if yaw == 0.0 { "m/s" } else { "rad/s" };
        let name = match trial["name"].as_str().unwrap() {
            "stand" => "stand".to_owned(),
            name => format!("{name} {:.2} {unit}", (x + y + yaw).abs()),
        };
        let cells = row(rows, &[&name]);
        for (cell, key) in cells[1..].iter().zip(["x", "y", "yaw"]) {
            shows(cell, &trial[key]["mean"], &name);
        }
    }
    for ground in result["ground"].as_array().into_iter().flatten() {
        let cells = row(rows, &[ground["ground"].as_str().unwrap(), &ground["level"].to_string()]);
        shows(cells[4], &percent(&ground["crossed"]["mean"]), "crossed");
    }
}

fn shows_loop(rows: &Value, result: &Value) {
    for one in result["evaluations"].as_array().unwrap() {
        let (policy, on) = (one["policy"].as_str().unwrap(), one["on"].as_str().unwrap());
        // Pages have words for the first and the last policy.
        let shown = match policy {
            "π₀" => "before",
            last if result["after"] == last => "after",
            other => other,
        };
        let cells = row(rows, &[shown, on]);
        shows(cells[2], &one["trajectories"], policy);
        shows(cells[3], &one["linear_velocity_error"]["mean"], policy);
        shows(cells[4], &one["angular_velocity_error"]["mean"], policy);
        shows(cells[6], &percent(&one["fall_rate"]["mean"]), policy);
    }
    for parameter in result["rounds"][0]["adapt"]["fits"][0]["parameters"].as_array().unwrap() {
        let name = parameter["name"].as_str().unwrap();
        shows(row(rows, &[name])[1], &parameter["value"], name);
    }
}
