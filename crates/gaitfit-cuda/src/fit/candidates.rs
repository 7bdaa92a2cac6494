//! Candidates simulated on a GPU, as many at once as fit, and what their costs are made of.

use std::sync::{Arc, Mutex, PoisonError};

use gaitfit_policy::follow::Job;
use gaitfit_policy::walker::WalkerError;
use gaitfit_sim::pool;

use super::scene::by_structure;
use super::session::{Physics, Session};
use super::{Begin, FitError, Numbers, Structure, Subject, Tables, Tracks};
use crate::runtime::{Device, Event, HostBuffer, Stream};

/// Max number of candidates whose signals are brought to the host at once.
const MAX_SHOWN: usize = 64;
/// Max bytes of signals that are brought to the host at once, of logs and predictions. One robot alone may have more.
const MAX_SHOWN_BYTES: usize = 256 << 20;

/// The robot's side of the costs.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Measured {
    /// Samples at the beginning of each recording that do not count.
    pub skip: usize,
    /// Samples that count, of all recordings, dimension by dimension, each ascending.
    pub sorted: Vec<f64>,
    /// `recordings × samples × dimensions`; what is behind a recording's end is not looked at.
    pub samples: Vec<f64>,
}

/// The part of a cost that is computed of a candidate.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Compared {
    /// Wasserstein-1 distances of pooled samples.
    Distances,
    /// Sums of squared differences.
    Squares,
}

/// Parts of a candidate's cost.
#[derive(Clone, Debug, PartialEq)]
pub struct Parts {
    /// Sample of the fall in each recording, or the number of samples.
    pub ends: Vec<u32>,
    /// Distance or sum of squares of each dimension of the signals, unscaled.
    pub pieces: Vec<f64>,
}

/// Simulates candidates on the recordings of some tables. Memory is taken at the first use, and a message says what does
/// not fit; where not all candidates fit they are simulated in turn.
pub struct Candidates {
    device: Device,
    stream: Stream,
    tables: Arc<Tables>,
    measured: Option<Arc<Measured>>,
    threads: usize,
    sessions: Vec<Session>,
    /// The physics of sessions that there were.
    known: Known,
    /// Signals on the host.
    shown: HostBuffer<f32>,
}

/// The physics of all structures so far. Candidates of one robot may share it.
pub(super) type Known = Arc<Mutex<Vec<Physics>>>;

impl Candidates {
    /// Candidates on `device`. `threads`: of the host, for what it prepares.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn new(device: &Device, tables: impl Into<Arc<Tables>>, threads: usize) -> Result<Self, FitError> {
        Self::sharing(device, tables.into(), threads, Known::default())
    }

    /// As [`Candidates::new`], with the physics that others of the same robot have.
    pub(super) fn sharing(
        device: &Device,
        tables: Arc<Tables>,
        threads: usize,
        known: Known,
    ) -> Result<Self, FitError> {
        let stream = Stream::new(device)?;
        let device = device.clone();
        let (sessions, shown) = (Vec::new(), HostBuffer::default());
        Ok(Self { device, stream, tables, measured: None, threads, sessions, known, shown })
    }

    /// The number of its GPU.
    pub(super) fn ordinal(&self) -> usize {
        self.device.info().ordinal
    }

    /// The recordings.
    pub fn tables(&self) -> &Tables {
        &self.tables
    }

    /// Sets what candidates are compared with.
    ///
    /// # Errors
    /// Numbers of other recordings or dimensions.
    pub fn measure(&mut self, measured: impl Into<Arc<Measured>>, dimensions: usize) -> Result<(), FitError> {
        let measured = measured.into();
        let expected = self.tables.recordings() * self.tables.samples * dimensions;
        if measured.samples.len() != expected {
            let found = measured.samples.len();
            return Err(FitError::Length { what: "the robot's side", expected, found });
        }
        self.measured = Some(measured);
        self.sessions.clear();
        Ok(())
    }

    /// Computes the parts of each job's cost that `compared` asks for. [`Candidates::measure`] must be called before.
    ///
    /// # Errors
    /// Candidates that cannot be simulated; a failure of the GPU; [`FitError::Cancelled`].
    pub fn parts(
        &mut self,
        subject: Subject<'_>,
        jobs: &[Job],
        compared: &[Compared],
        cancel: &dyn Fn() -> bool,
    ) -> Result<Vec<Parts>, FitError> {
        let (recordings, dimensions) = (self.tables.recordings(), subject.dimensions());
        // The base of a robot that walks is not compared by distances.
        let by_distance = match subject {
            // The last six: position and velocity.
            Subject::Walk(..) => dimensions.saturating_sub(6),
            Subject::Predict(_) | Subject::Replay(_) => dimensions,
        };
        let mut parts: Vec<Option<Parts>> = vec![None; jobs.len()];
        // Candidates of one structure share a compiled program.
        for (structure, mut own) in self.groups(subject, jobs)? {
            // A session computes distances of its first candidates alone.
            own.sort_by_key(|&job| compared[job] == Compared::Squares);
            let mut rest = own.as_slice();
            while !rest.is_empty() {
                if cancel() {
                    return Err(FitError::Cancelled);
                }
                let session = self.session(subject, &structure, &jobs[rest[0]], rest.len())?;
                let (now, later) = rest.split_at(rest.len().min(self.sessions[session].capacity()));
                rest = later;
                let distances = now.iter().filter(|&&job| compared[job] == Compared::Distances).count();
                self.run(subject, session, now, jobs, None)?;
                let (near, squares, ends) = self.sessions[session].compare(
                    &self.stream,
                    distances,
                    by_distance,
                    distances < now.len(),
                )?;
                for (place, &job) in now.iter().enumerate() {
                    let pieces = if place < distances { &near } else { &squares };
                    parts[job] = Some(Parts {
                        ends: ends[place * recordings..(place + 1) * recordings].to_vec(),
                        pieces: pieces[place * dimensions..(place + 1) * dimensions].to_vec(),
                    });
                }
            }
        }
        Ok(parts.into_iter().flatten().collect())
    }

    /// Simulates every job and hands `consume(job, recording, tracks)` its signals, once, from any thread.
    ///
    /// # Errors
    /// As [`Candidates::parts`].
    pub fn tracks(
        &mut self,
        subject: Subject<'_>,
        jobs: &[Job],
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), FitError> {
        self.walks(subject, jobs, None, MAX_SHOWN, consume, cancel)
    }

    /// As [`Candidates::tracks`], for robots that make logs, on tables of [`Tables::for_logs`]. `begins[job][recording]` states how
    /// robot `job` begins a recording.
    ///
    /// # Errors
    /// As [`Candidates::parts`]. Also if the numbers of beginnings differ from those of jobs and recordings, or if a robot walks
    /// more samples before a recording than the tables allow.
    pub fn make_logs(
        &mut self,
        subject: Subject<'_>,
        jobs: &[Job],
        begins: &[Vec<Begin>],
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), FitError> {
        let recordings = self.tables.recordings();
        let mut counts =
            [(jobs.len(), begins.len())].into_iter().chain(begins.iter().map(|all| (recordings, all.len())));
        if let Some((expected, found)) = counts.find(|(expected, found)| expected != found) {
            return Err(FitError::Length { what: "the beginnings", expected, found });
        }
        // Only these tables have room for samples before a recording.
        let Some(max) = self.tables.earlier else {
            return Err(FitError::Unsupported(
                "logs on tables that were not made by Tables::for_logs".to_owned(),
            ));
        };
        if let Some(begin) = begins.iter().flatten().find(|begin| begin.earlier as usize > max) {
            let found = begin.earlier as usize;
            return Err(FitError::Length { what: "samples before a recording", expected: max, found });
        }
        self.walks(subject, jobs, Some(begins), shown(subject, &self.tables), consume, cancel)
    }

    /// Whether a session is there for predictions of `wanted` candidates of this structure on the recordings of `tables`.
    pub(super) fn has_prediction_session(
        &self,
        subject: Subject<'_>,
        tables: &Tables,
        (structure, wanted): (&Structure, usize),
    ) -> bool {
        self.prediction_session(tables, structure, room(wanted.min(shown(subject, tables)))).is_some()
    }

    /// Number of the session for predictions.
    fn prediction_session(&self, tables: &Tables, structure: &Structure, room: usize) -> Option<usize> {
        self.sessions.iter().position(|session| {
            session.physics.structure == *structure
                && session.asked == room
                && session.tables.has_sizes_of(tables)
        })
    }

    /// Predicts the recordings of `tables` by the first of some candidates like `example`, as many as there is room for. `numbers`:
    /// those of all candidates, and how many there are. Returns the signals, and of how many candidates they are.
    ///
    /// # Errors
    /// As [`Candidates::parts`].
    pub(super) fn predict(
        &mut self,
        subject: Subject<'_>,
        tables: &Arc<Tables>,
        example: &Job,
        (numbers, wanted): (&Numbers, usize),
    ) -> Result<(&[f32], usize), FitError> {
        let structure = Structure::new(&example.candidate);
        // The host takes in at most so many, so more need not be computed at once.
        let shown = wanted.min(shown(subject, tables));
        let room = room(shown);
        let session = match self.prediction_session(tables, &structure, room) {
            Some(there) => there,
            None => {
                self.tables = Arc::clone(tables);
                // Logs of other sizes will hardly come again.
                self.sessions.retain(|session| session.tables.has_sizes_of(tables));
                let made = self.new_session(subject, example, room);
                let full = made.as_ref().is_ok_and(|&made| self.sessions[made].capacity() == room);
                if !full && self.sessions.len() > usize::from(made.is_ok()) {
                    // Again without the others' memory.
                    self.sessions.clear();
                    self.new_session(subject, example, room)?
                } else {
                    made?
                }
            }
        };
        // A session with half of its tables replaced must not be found again.
        if let Err(error) = self.sessions[session].take_tables(&self.stream, tables) {
            self.sessions.clear();
            return Err(error.into());
        }
        let session = &mut self.sessions[session];
        session.run(&self.stream, numbers, wanted)?;
        let now = shown.min(session.capacity());
        let (signals, _) = session.read(&self.stream, now, &mut self.shown)?;
        Ok((signals, now))
    }

    /// [`Candidates::tracks`] or [`Candidates::make_logs`]. `shown`: max number of candidates at once.
    fn walks(
        &mut self,
        subject: Subject<'_>,
        jobs: &[Job],
        begins: Option<&[Vec<Begin>]>,
        shown: usize,
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), FitError> {
        let tables = Arc::clone(&self.tables);
        let (recordings, dimensions) = (tables.recordings(), tables.dimensions(subject));
        for (structure, own) in self.groups(subject, jobs)? {
            let mut rest = own.as_slice();
            while !rest.is_empty() {
                if cancel() {
                    return Err(FitError::Cancelled);
                }
                let session = self.session(subject, &structure, &jobs[rest[0]], rest.len().min(shown))?;
                let (now, later) = rest.split_at(rest.len().min(self.sessions[session].capacity()));
                rest = later;
                self.run(subject, session, now, jobs, begins)?;
                let (signals, ends) =
                    self.sessions[session].read(&self.stream, now.len(), &mut self.shown)?;
                let lengths = &tables.lengths;
                let size = tables.samples * dimensions;
                pool::for_each(
                    now.len() * recordings,
                    self.threads,
                    || (),
                    |(), run| {
                        let (place, recording) = (run / recordings, run % recordings);
                        // Recordings share one length in memory; rows behind a recording's end are not shown.
                        let (length, end) = (lengths[recording] as usize, ends[run] as usize);
                        let rows = &signals[run * size..][..length * dimensions];
                        let fell_at = (end < length).then_some(end);
                        consume(now[place], recording, Tracks { rows, dimensions, fell_at });
                    },
                );
            }
        }
        Ok(())
    }

    /// Jobs of one structure together, by their numbers.
    fn groups(&self, subject: Subject<'_>, jobs: &[Job]) -> Result<Vec<(Structure, Vec<usize>)>, FitError> {
        if !self.tables.has_states && jobs.iter().any(|job| job.reset_every.is_some()) {
            return Err(WalkerError::NoStates.into());
        }
        let resets = jobs.iter().any(|job| job.reset_every.is_some());
        if resets && matches!(subject, Subject::Walk(_, policy) if policy.is_recurrent()) {
            return Err(WalkerError::NoMemory.into());
        }
        if resets && matches!(subject, Subject::Walk(walker, _) if walker.sees_past()) {
            let what = "resets to the log (matchs) of a policy that observes a history or `earlier_action`";
            return Err(FitError::Unsupported(what.to_owned()));
        }
        Ok(by_structure(jobs.iter().map(|job| &job.candidate)))
    }

    /// Number of the session of candidates like `example`, with room for `wanted` of them if they fit.
    fn session(
        &mut self,
        subject: Subject<'_>,
        structure: &Structure,
        example: &Job,
        wanted: usize,
    ) -> Result<usize, FitError> {
        let there = self.sessions.iter().position(|session| session.physics.structure == *structure);
        if let Some(there) = there
            && self.sessions[there].capacity().max(self.sessions[there].asked) >= wanted
        {
            return Ok(there);
        }
        if let Some(there) = there {
            // The memory of a smaller one is free for the larger.
            self.sessions.remove(there);
        }
        self.new_session(subject, example, wanted)
    }

    /// Makes a session for `wanted` candidates like `example`, or as many as fit; its number.
    fn new_session(&mut self, subject: Subject<'_>, example: &Job, wanted: usize) -> Result<usize, FitError> {
        let structure = Structure::new(&example.candidate);
        // Locked while the program text is made, so that two threads do not make the same one.
        let mut known = self.known.lock().unwrap_or_else(PoisonError::into_inner);
        let physics = match known.iter().find(|known| known.structure == structure) {
            Some(known) => known.clone(),
            None => {
                let physics = Physics::new(subject, &example.candidate)?;
                known.push(physics.clone());
                physics
            }
        };
        drop(known);
        let measured = self.measured.as_deref();
        let tables = Arc::clone(&self.tables);
        let session = Session::new(&self.device, &self.stream, subject, physics, tables, measured, wanted)?;
        self.sessions.push(session);
        Ok(self.sessions.len() - 1)
    }

    fn run(
        &mut self,
        subject: Subject<'_>,
        session: usize,
        now: &[usize],
        jobs: &[Job],
        begins: Option<&[Vec<Begin>]>,
    ) -> Result<(), FitError> {
        let chosen: Vec<Job> = now.iter().map(|&job| jobs[job].clone()).collect();
        let session = &mut self.sessions[session];
        let mut numbers = Numbers::new(subject, &chosen, self.tables.starts, self.threads)?;
        if let Some(begins) = begins {
            let begins: Vec<&[Begin]> = now.iter().map(|&job| begins[job].as_slice()).collect();
            numbers = numbers.beginning(&begins);
        }
        session.run(&self.stream, &numbers, chosen.len())
    }

    /// Registers and bytes of local memory of each kernel of the sessions so far, and the bytes of the GPU's memory.
    ///
    /// # Errors
    /// A failure of the GPU.
    #[allow(clippy::type_complexity, reason = "a list and a number")]
    pub fn resources(&self) -> Result<(Vec<(String, i32, i32)>, u64), FitError> {
        let mut kernels = Vec::new();
        for session in &self.sessions {
            kernels.extend(session.resources()?);
        }
        Ok((kernels, self.sessions.iter().map(Session::bytes).sum()))
    }

    /// Seconds that all steps of the last session's parts take, each part alone: all, the policy's kernel, random
    /// torques, the physics. The candidates' state is spoilt.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn breakdown(&self) -> Result<Vec<(&'static str, f64)>, FitError> {
        let mut times = Vec::new();
        let Some(session) = self.sessions.last() else { return Ok(times) };
        for part in ["all", "step", "disturb", "physics"] {
            let mut graph = self.stream.record(|stream| session.start_part(stream, part))?;
            let (from, to) = (Event::new(&self.device)?, Event::new(&self.device)?);
            graph.launch(&self.stream)?;
            from.record(&self.stream)?;
            graph.launch(&self.stream)?;
            to.record(&self.stream)?;
            times.push((part, from.seconds_until(&to)?));
        }
        Ok(times)
    }
}

/// Room that a session of predictions has for `wanted` candidates: rounded up by at most an eighth, so that similar numbers share a
/// session. Each computes its whole room, however few candidates it is given.
fn room(wanted: usize) -> usize {
    wanted.next_multiple_of((wanted.next_power_of_two() / 16).max(1))
}

/// Max number of candidates whose signals come to the host at once.
fn shown(subject: Subject<'_>, tables: &Tables) -> usize {
    let each = 4 * tables.recordings() * tables.samples * tables.dimensions(subject);
    (MAX_SHOWN_BYTES / each.max(1)).max(1)
}
