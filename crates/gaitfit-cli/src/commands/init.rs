//! `gaitfit init`: looks at a robot and writes a task for it.

mod trainings;

use crate::cli::Init;
use crate::exit::{Exit, Failure};
use crate::output;
use gaitfit::files::{self, Output};
use gaitfit::init::{Guess, Look, Preparation, Prepared, prepare};
use gaitfit::{paths, robot};
use gaitfit_model::argument;
use serde::Serialize;
use std::path::{Path, PathBuf};
use trainings::{Training, remedy, train_guesses, tried};

/// The result, as `--json` prints it.
#[derive(Serialize)]
struct Document {
    robot: String,
    written: String,
    /// The mended robot file, where one was written.
    #[serde(skip_serializing_if = "Option::is_none")]
    robot_file: Option<String>,
    /// The page of the stance.
    #[serde(skip_serializing_if = "Option::is_none")]
    page: Option<String>,
    guesses: Vec<Guess>,
    warnings: Vec<String>,
    /// The training, with `--train`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    trainings: Vec<Training>,
}

/// The folder of the files.
struct Files {
    configuration: PathBuf,
    mended: Option<PathBuf>,
    page: Option<PathBuf>,
}

impl Files {
    /// Refuses to overwrite what is there, unless that is asked for.
    fn new(args: &Init, prepared: &Prepared) -> Result<Self, Failure> {
        let configuration = args.out.clone().unwrap_or_else(|| file_for(&prepared.model.name));
        // All files have the configuration's name, so that several robots fit into one folder.
        let stem = configuration.file_stem().map(|stem| stem.to_string_lossy().into_owned());
        let stem = stem.unwrap_or_default();
        // The robot's own file stays as it is.
        let plain = configuration.with_extension("xml");
        let whole = |path: &Path| std::fs::canonicalize(path).ok();
        let is_given_file = whole(&plain).is_some_and(|path| whole(&args.robot) == Some(path));
        let beside =
            if is_given_file { configuration.with_file_name(format!("{stem}-mended.xml")) } else { plain };
        let mended = prepared.file.as_ref().map(|_| beside);
        let page = (!args.no_picture).then(|| configuration.with_file_name(format!("{stem}-stance.html")));
        let mut outputs = vec![Output { path: &configuration, option: "--out", ending: Some("toml") }];
        outputs.extend(mended.as_ref().map(|path| Output {
            path,
            option: "the mended robot file",
            ending: None,
        }));
        outputs.extend(page.as_ref().map(|path| Output {
            path,
            option: "the page of the stance",
            ending: None,
        }));
        // All outputs are checked before any is written, so that no half of them is left.
        files::check(&outputs, [args.robot.as_path()])?;
        for path in [Some(&configuration), mended.as_ref(), page.as_ref()].into_iter().flatten() {
            if path.exists() && !args.force {
                return Err(Failure::usage(format!(
                    "{} exists already; give another --out, or --force to overwrite it",
                    path.display()
                )));
            }
        }
        Ok(Self { configuration, mended, page })
    }
}

/// Writes the configuration, and a mended robot file where that is needed, prints what was guessed, and trains it if asked to.
pub fn run(args: &Init) -> Result<(), Failure> {
    if robot::is_built_in(&args.robot) {
        return Err(Failure::usage(
            "the built-in Go2 needs no configuration: `gaitfit train` trains a policy for it, and `gaitfit config train` prints the settings",
        ));
    }
    let how = Preparation {
        lenient: args.lenient,
        feet_from_mesh: args.feet_from_mesh,
        one_file: args.one_file,
        folder: args.out.as_deref().and_then(Path::parent),
    };
    let prepared = prepare(&args.robot, how)?;
    let files = Files::new(args, &prepared)?;
    if let (Some(path), Some(text)) = (&files.mended, &prepared.file) {
        files::write(path, text.as_bytes())?;
    }
    if let Some(path) = &files.page {
        let page =
            gaitfit_view::replay_html(&prepared.look.stance(&prepared.model)).map_err(Failure::failed)?;
        files::write(path, page.as_bytes())?;
    }
    write_configuration(args, &files, &prepared.look)?;
    let path = |path: &Path| path.display().to_string();
    let mut document = Document {
        robot: prepared.model.name.clone(),
        written: path(&files.configuration),
        robot_file: files.mended.as_deref().map(path),
        page: files.page.as_deref().map(path),
        warnings: robot::remarks(&prepared.model),
        guesses: prepared.mended.iter().chain(&prepared.look.guesses).cloned().collect(),
        trainings: Vec::new(),
    };
    // Trainings take long, so what was guessed is printed before they begin.
    if args.train {
        if !args.json {
            output::print(&shown(&document))?;
        }
        document.trainings = train_guesses(args, &files, &prepared)?;
    }
    match (args.json, args.train) {
        (true, _) => output::print_json(&document)?,
        (false, false) => {
            let configuration = argument(&files.configuration);
            output::print(&format!("{}next: gaitfit train {configuration}\n", shown(&document)))?;
        }
        (false, true) => {
            let walks = document.trainings.iter().find(|training| training.walks);
            let policy = walks.and_then(|training| training.policy.clone());
            output::print(&tried(&document.trainings))?;
            if let Some(policy) = policy {
                output::next(&[format!(
                    "gaitfit evaluate {} --report evaluation.html",
                    argument(Path::new(&policy))
                )])?;
            }
        }
    }
    // Scripts see by the exit code that no policy walks.
    match document.trainings.iter().any(|training| training.walks) || !args.train {
        true => Ok(()),
        false => Err(Failure {
            exit: Exit::Check,
            message: remedy(args, &document.trainings, &files.configuration),
        }),
    }
}

fn write_configuration(args: &Init, files: &Files, look: &Look) -> Result<(), Failure> {
    let robot_file = files.mended.as_deref().unwrap_or(&args.robot);
    // A mended file does not contain the dropped parts.
    let lenient = args.lenient && files.mended.is_none();
    let text = look.configuration(&paths::named(robot_file, &files.configuration), lenient);
    Ok(files::write(&files.configuration, text.as_bytes())?)
}

/// The robot's name as a file in the current folder.
fn file_for(robot: &str) -> PathBuf {
    let plain = |letter: char| {
        if letter.is_ascii_alphanumeric() || "_-.".contains(letter) { letter } else { '-' }
    };
    // File systems allow 255 bytes, and endings such as `-stance.html` follow. A longer name would fail at the end.
    let name: String = robot.chars().map(plain).take(64).collect();
    // A dot in front hides a file, and a dash makes it look like an option.
    let name = name.trim_matches(['.', '-']);
    PathBuf::from(format!("{}.toml", if name.is_empty() { "robot" } else { name }))
}

fn shown(document: &Document) -> String {
    let mut text = format!("{}: {}\n", document.robot, document.written);
    let mut line = |what: &str, value: &str| text.push_str(&format!("  {what:<10}{value}\n"));
    if let Some(file) = &document.robot_file {
        line("robot", &format!("{file}: the robot's file, mended; it lists what changed"));
    }
    for guess in &document.guesses {
        line(guess.what, &guess.found);
    }
    if let Some(page) = &document.page {
        line("page", &format!("{page}: the stance and the gait"));
    }
    for warning in &document.warnings {
        text.push_str(&format!("note: {warning}\n"));
    }
    text
}
