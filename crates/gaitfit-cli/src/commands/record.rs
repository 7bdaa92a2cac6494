//! `gaitfit record`: topics of a robot that speaks ROS 2, as a log.

use crate::cli::Record;
use crate::exit::Failure;
use gaitfit::files;
use gaitfit_import::{MAX_MAPPING_BYTES, Mapping, is_known, known_types};
use gaitfit_robot::listen::{Topic, topics};

/// The topics of the file of `--topics`. The file is an import's mapping too.
fn wanted(args: &Record) -> Result<Vec<Topic>, Failure> {
    let shown = args.topics.display();
    if let Some(seconds) = args.seconds.filter(|seconds| !(*seconds > 0.0 && seconds.is_finite())) {
        return Err(Failure::usage(format!("--seconds {seconds}: give a length above 0 s")));
    }
    let text = files::read_text(&args.topics, MAX_MAPPING_BYTES)
        .map_err(|error| Failure::usage(format!("cannot read {shown}: {error}")))?;
    let mapping = Mapping::parse(&text).map_err(|error| Failure::usage(format!("{shown}: {error}")))?;
    let topics = topics(&mapping.topics).map_err(|error| Failure::usage(format!("{shown}: {error}")))?;
    if let Some(topic) = topics.iter().find(|topic| !is_known(&topic.kind)) {
        return Err(Failure::usage(format!(
            "{shown}: topics: the type `{}` of `{}` is not known; known are {}",
            topic.kind,
            topic.name,
            known_types().join(", ")
        )));
    }
    Ok(topics)
}

/// Listens, writes what comes as a recording, and makes a log of it.
#[cfg(feature = "dds")]
pub fn run(args: &Record) -> Result<(), Failure> {
    let topics = wanted(args)?;
    dds::record(args, &topics)
}

/// Says how to get DDS; a file that is wrong is refused before.
#[cfg(not(feature = "dds"))]
pub fn run(args: &Record) -> Result<(), Failure> {
    wanted(args)?;
    Err(Failure {
        exit: crate::exit::Exit::Missing,
        message: format!(
            "--interface {}: this program was built without DDS; build it with `cargo build --release --features dds`",
            args.interface
        ),
    })
}

#[cfg(feature = "dds")]
mod dds {
    use std::fs::File;
    use std::io::BufWriter;
    use std::path::Path;
    use std::time::{Duration, Instant};

    use super::{Failure, Record, Topic, files};
    use crate::cli::Import;
    use crate::commands::{import, run::usage};
    use crate::output::note;
    use crate::signals;
    use gaitfit::files::Output;
    use gaitfit_import::Bag;
    use gaitfit_model::argument;
    use gaitfit_robot::listen::Listener;

    /// Time between two looks at what has come.
    const LOOK: Duration = Duration::from_millis(20);
    /// Time to wait for the first message of each topic. After it, the other topics are listed.
    const SILENT: Duration = Duration::from_secs(8);
    /// Largest recording, bytes: what an import reads.
    const MAX_BYTES: u64 = 1_000_000_000;

    /// The messages of a topic.
    #[derive(Clone, Default)]
    struct Count {
        messages: u64,
        first: u64,
        last: u64,
    }

    pub fn record(args: &Record, topics: &[Topic]) -> Result<(), Failure> {
        // The raw messages are kept: the log can be made again with another mapping, the recording cannot.
        let recording = args.out.with_extension("mcap");
        let inputs = [args.topics.as_path()];
        files::check(&[Output { path: &args.out, option: "--out", ending: Some("csv") }], inputs)?;
        signals::listen()?;
        let mut listener = Listener::open(&args.interface, args.domain, topics).map_err(usage)?;
        let names: Vec<(&str, &str)> = topics.iter().map(|topic| (&*topic.name, &*topic.kind)).collect();
        // A recording cannot be made again, so none is overwritten.
        let file = File::create_new(&recording).map_err(|error| {
            Failure::usage(format!(
                "{}: {error}; name another --out, so that no recording is lost",
                recording.display()
            ))
        })?;
        let mut bag = Bag::new(BufWriter::new(file), &names).map_err(Failure::failed)?;
        note(&format!(
            "listening to {} topics on {}, domain {}; Ctrl-C ends the recording",
            topics.len(),
            args.interface,
            args.domain
        ));
        // By topic, because one that is silent is the usual fault.
        let mut counts = vec![Count::default(); topics.len()];
        let (begin, mut first, mut warned) = (Instant::now(), None, false);
        let (mut lost, mut bytes) = (0, 0u64);
        loop {
            std::thread::sleep(LOOK);
            let (heard, more) = listener.take();
            lost += more;
            if !heard.is_empty() {
                first.get_or_insert_with(Instant::now);
            }
            for message in heard {
                let count = &mut counts[message.topic];
                if count.messages == 0 {
                    count.first = message.ns;
                    note(&format!("{}: the first message came", topics[message.topic].name));
                }
                count.messages += 1;
                count.last = message.ns;
                // About what MCAP adds to each message.
                bytes += message.bytes.len() as u64 + 64;
                bag.message(message.topic, message.ns, &message.bytes).map_err(Failure::failed)?;
            }
            if !warned && begin.elapsed() > SILENT {
                warned = true;
                silent(topics, &counts, &listener);
            }
            // The time counts from the first message, as a robot may be switched on late.
            let over = match (first, args.seconds) {
                (Some(first), Some(seconds)) => first.elapsed().as_secs_f64() >= seconds,
                // Nothing came at all.
                (None, Some(seconds)) => begin.elapsed().as_secs_f64() >= seconds + SILENT.as_secs_f64(),
                _ => false,
            };
            if bytes > MAX_BYTES {
                note("the recording has 1 GB, which is as much as an import reads; it ends here");
            }
            if over || bytes > MAX_BYTES || signals::asked().is_some() {
                break;
            }
        }
        bag.finish().map_err(Failure::failed)?;
        drop(bag);
        for (topic, count) in topics.iter().zip(&counts) {
            note(&format!("{}: {}", topic.name, heard(count)));
        }
        if lost > 0 {
            note(&format!(
                "{lost} messages were lost: too long, unreadable, or too many at once for this computer"
            ));
        }
        if counts.iter().all(|count| count.messages == 0) {
            // A file without a message is of no use to anybody.
            let _ = std::fs::remove_file(&recording);
            return Err(Failure::failed(format!(
                "no message came on any topic; {}",
                published(topics, &listener)
            )));
        }
        // Kept until here, as a message above may name the topics that were seen.
        drop(listener);
        note(&format!("{}: the recording as it came", recording.display()));
        as_log(args, &recording)
    }

    /// The log of the recording, as an import makes it.
    fn as_log(args: &Record, recording: &Path) -> Result<(), Failure> {
        import::run(&Import {
            files: vec![recording.to_owned()],
            out: args.out.clone(),
            mapping: Some(args.topics.clone()),
            robot: args.robot.clone(),
            json: args.json,
            ..Import::default()
        })
        .map_err(|mut failure| {
            failure.message = format!(
                "{}. The recording is kept; after a change of the file import it again: gaitfit import {} --mapping {} --out {}",
                failure.message,
                argument(recording),
                argument(&args.topics),
                argument(&args.out)
            );
            failure
        })
    }

    fn heard(count: &Count) -> String {
        match count.messages {
            0 => "no message".to_owned(),
            1 => "1 message".to_owned(),
            many => {
                let seconds = (count.last - count.first) as f64 / 1e9;
                // N messages have N − 1 intervals. Two messages may have come at the same nanosecond.
                format!("{many} messages, {:.1} a second", (many - 1) as f64 / seconds.max(1e-9))
            }
        }
    }

    /// Says which topics are silent, and what is published instead.
    fn silent(topics: &[Topic], counts: &[Count], listener: &Listener) {
        let silent: Vec<&str> = topics
            .iter()
            .zip(counts)
            .filter(|(_, count)| count.messages == 0)
            .map(|(t, _)| &*t.name)
            .collect();
        if !silent.is_empty() {
            note(&format!("no message yet on {}; {}", silent.join(", "), published(topics, listener)));
        }
    }

    /// The topics that others publish, for a person who looks for a name.
    fn published(topics: &[Topic], listener: &Listener) -> String {
        let others: Vec<String> = listener
            .published()
            .iter()
            .filter(|topic| !topics.contains(topic))
            // A robot can have hundreds of topics, and a longer list hides the wanted one.
            .take(40)
            .map(|topic| format!("{} ({})", topic.name.escape_debug(), topic.kind.escape_debug()))
            .collect();
        if others.is_empty() {
            return "no other topic is published in this domain either: check the interface, ROS_DOMAIN_ID, and whether the \
                    robot uses another middleware than DDS"
                .to_owned();
        }
        format!("others publish {}", others.join(", "))
    }
}
