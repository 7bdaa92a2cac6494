//! The experiment files: one loop configuration a cell.

use super::paper::{Paper, PaperCell, Table};
use crate::Error;
use crate::settings::{self, LoopConfig, TargetKind};
use gaitfit_adapt::cost::CostKind;
use globset::Glob;
use std::path::{Path, PathBuf};

/// A cell and its file's settings.
pub struct Experiment {
    /// The cell in the paper.
    pub paper: PaperCell,
    /// Name of the scenario: the difference on the target.
    pub scenario: String,
    /// Names of the modification that is fitted and of the cost that is minimised.
    pub parts: [String; 2],
    /// Its file.
    pub file: PathBuf,
    /// Its settings.
    pub config: LoopConfig,
    /// Whether it is to be run; the others of the table only share logs and references with it.
    pub selected: bool,
}

/// Reads the files of a table from `folder`, `sets` applied on top.
///
/// # Errors
/// A file that is missing or wrong, cells of a scenario whose targets differ, a pattern without a cell.
pub fn read(
    paper: &Paper,
    table: &Table,
    folder: &Path,
    full: bool,
    sets: &[String],
    only: Option<&str>,
) -> Result<Vec<Experiment>, Error> {
    let matcher = only
        .map(|pattern| {
            let glob =
                Glob::new(pattern).map_err(|error| Error::settings(format!("--only {pattern}: {error}")))?;
            Ok::<_, Error>(glob.compile_matcher())
        })
        .transpose()?;
    // All cells are read, those that are not selected too: references are shared with them.
    let mut experiments = Vec::with_capacity(table.cells.len());
    for cell in &table.cells {
        let selected = matcher.as_ref().is_none_or(|matcher| matcher.is_match(&cell.name));
        // The paper's method takes values as its search finds them; --set can ask for more.
        let mut changes = vec!["adapt.optimizer.replicates=0".to_owned()];
        if full {
            changes.extend(paper.full(cell));
        }
        // Last, so that the command line wins.
        changes.extend_from_slice(sets);
        experiments.push(one(cell, folder, &changes, selected)?);
    }
    if let (Some(pattern), false) = (only, experiments.iter().any(|one| one.selected)) {
        let names: Vec<&str> = table.cells.iter().map(|cell| cell.name.as_str()).collect();
        return Err(Error::settings(format!(
            "--only {pattern}: no cell of {} matches; there are {}",
            table.name,
            names.join(", ")
        )));
    }
    for (index, later) in experiments.iter().enumerate() {
        // Comparing with the first cell of a scenario is enough: equality carries over.
        if let Some(first) = experiments[..index].iter().find(|one| one.scenario == later.scenario) {
            check_shared(first, later)?;
        }
    }
    Ok(experiments)
}

fn one(cell: &PaperCell, folder: &Path, sets: &[String], selected: bool) -> Result<Experiment, Error> {
    let file = folder.join(format!("{}.toml", cell.name));
    if !file.is_file() {
        return Err(Error::settings(format!(
            "{} does not exist; run from the repository's root, or say with --experiments where the files are",
            file.display()
        )));
    }
    let mut config: LoopConfig = settings::load(Some(&file), sets)?;
    // The table names the folders.
    config.name = None;
    // All logs count, as in the paper.
    config.held_out = 0;
    config.check(&file)?;
    let wrong = |what: &str| Err(Error::settings(format!("{}: {what}", file.display())));
    if config.target.as_ref().is_none_or(|target| target.kind != TargetKind::Simulated) {
        return wrong("an experiment needs a [target] of kind = \"simulated\": its truth is known");
    }
    if !config.logs.is_empty() || config.rounds != 1 {
        return wrong("an experiment records its own logs, in one round; leave `logs` and `rounds` out");
    }
    if config.adapt.costs.len() != 1 {
        return wrong("an experiment has one cost; `adapt.costs` must name one");
    }
    let Some([scenario, modification, cost]) = cell.parts() else {
        return wrong("an experiment is named scenario-modification-cost");
    };
    Ok(Experiment {
        scenario: scenario.to_owned(),
        parts: [modification.to_owned(), cost.to_owned()],
        paper: cell.clone(),
        file,
        config,
        selected,
    })
}

/// Cells of a scenario share logs and references: what these depend on must be the same.
fn check_shared(first: &Experiment, later: &Experiment) -> Result<(), Error> {
    let (a, b) = (&first.config, &later.config);
    let (fit, other) = (&a.adapt.simulation, &b.adapt.simulation);
    // Not the rest of `[adapt]`: the fits are what the cells differ in.
    let differs = [
        ("policy", a.policy != b.policy),
        ("robot", a.robot != b.robot || a.lenient != b.lenient),
        ("runs", a.runs != b.runs),
        ("[target]", a.target != b.target),
        ("[finetune]", a.finetune != b.finetune),
        ("[controls]", a.controls != b.controls),
        ("[evaluate]", a.evaluate != b.evaluate),
        // Trainings read these, too.
        ("adapt.simulation.robot_timestep", fit.robot_timestep != other.robot_timestep),
        ("adapt.simulation.self_contact", fit.self_contact != other.self_contact),
    ];
    match differs.iter().find(|(_, differs)| *differs) {
        None => Ok(()),
        Some((what, _)) => Err(Error::settings(format!(
            "{}: its {what} differs from that of {}, with which it shares logs and references",
            later.file.display(),
            first.file.display()
        ))),
    }
}

impl Experiment {
    /// Its settings for a seed, from 1: other commands and noise, other candidates, another training; measured by the
    /// same trajectories.
    pub fn seeded(&self, seed: u64) -> LoopConfig {
        let mut config = self.config.clone();
        let offset = seed - 1;
        if let Some(target) = &mut config.target {
            target.seed = target.seed.saturating_add(offset);
        }
        let optimizer = &mut config.adapt.optimizer;
        // A fit takes consecutive seeds, at most this many: those of the next repetition begin behind them.
        optimizer.seed =
            optimizer.seed.saturating_add(offset.saturating_mul(optimizer.seed_count(true) as u64));
        let trainings = &mut config.finetune.seeds;
        // Seeds need not be consecutive, so the next repetition begins behind the largest one.
        let span = match (trainings.iter().min(), trainings.iter().max()) {
            (Some(&min), Some(&max)) => (max - min).saturating_add(1),
            _ => 0,
        };
        for training in trainings {
            *training = training.saturating_add(offset.saturating_mul(span));
        }
        config
    }
}

/// Returns one configuration for what the cells of a scenario share: the target, whose logs have the base's
/// state if any cell needs it, and the training of the reference.
pub fn shared(experiments: &[Experiment], scenario: &str, seed: u64) -> Option<LoopConfig> {
    let mut same_scenario = experiments.iter().filter(|one| one.scenario == scenario);
    let mut config = same_scenario.next()?.seeded(seed);
    let mut costs: Vec<CostKind> = Vec::new();
    for one in experiments.iter().filter(|one| one.scenario == scenario) {
        for &cost in &one.config.adapt.costs {
            if !costs.contains(&cost) {
                costs.push(cost);
            }
        }
    }
    // Nothing else of the fits than what trainings read: they differ from cell to cell, and the shared folder belongs to
    // one set of settings.
    let mut adapt = settings::AdaptConfig { costs, ..settings::AdaptConfig::default() };
    adapt.simulation.robot_timestep = config.adapt.simulation.robot_timestep;
    adapt.simulation.self_contact = config.adapt.simulation.self_contact.take();
    config.adapt = adapt;
    Some(config)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::settings::TargetConfig;
    use crate::{robot, target};
    use gaitfit_adapt::cmaes::CovarianceKind;
    use gaitfit_adapt::{JointParameter, NetworkName};
    use std::collections::BTreeSet;

    fn folder() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("../../experiments")
    }

    /// Checks that a target is the scenario's.
    fn check_target(scenario: &str, target: &TargetConfig, parameters: usize) {
        let springs: Vec<crate::Spring> =
            if scenario == "spring" { vec!["RR_calf_joint=75".parse().unwrap()] } else { Vec::new() };
        assert_eq!(target.spring, springs);
        let noise = scenario.strip_prefix("noise-").map(|sigma| sigma.parse::<f64>().unwrap());
        assert_eq!(target.torque_noise, noise.unwrap_or(0.0));
        assert_eq!(target.log_shift, if noise.is_some() { [0.02, 0.1] } else { [0.0, 0.0] });
        assert_eq!(parameters, if scenario == "spring" { 0 } else { 12 * 2 });
        assert_eq!((target.trajectories, target.seconds), (64, 4.0));
    }

    #[test]
    fn every_cells_file_is_there_reads_and_is_what_its_name_says() {
        let paper = Paper::read().unwrap();
        let model = robot::go2().unwrap();
        let joints: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
        let mut read_files = BTreeSet::new();
        for table in &paper.tables {
            for full in [false, true] {
                let experiments = read(&paper, table, &folder(), full, &[], None).unwrap();
                assert_eq!(experiments.len(), table.cells.len());
                for Experiment { paper: cell, scenario, parts: [modification, cost], file, config, .. } in
                    &experiments
                {
                    read_files.insert(cell.name.clone());
                    let target = config.target.as_ref().unwrap();
                    let (truth, _) = target::truth(target, file, &model).unwrap();
                    let covered: usize = truth.parameter.iter().map(|one| one.joints.len()).sum();
                    check_target(scenario, target, covered);
                    for one in &truth.parameter {
                        let group =
                            ["hip", "thigh", "calf"].into_iter().find(|group| one.joints[0].contains(group));
                        let name = format!("{}_{}", one.kind, group.unwrap());
                        assert_eq!(paper.truth[&name], one.value, "{}: {name}", cell.name);
                    }
                    assert_eq!(&config.adapt.costs[0].to_string(), cost, "{}", cell.name);
                    assert_eq!(config.adapt.optimizer.replicates, 0, "{}", cell.name);
                    let kinds: Vec<JointParameter> =
                        config.adapt.parameter.iter().map(|one| one.kind).collect();
                    let networks: Vec<NetworkName> =
                        config.adapt.network.iter().map(|one| one.kind).collect();
                    let generations = config.adapt.optimizer.generations;
                    match modification.as_str() {
                        "fricarm" => {
                            assert_eq!(kinds, [JointParameter::FrictionLoss, JointParameter::Armature]);
                            assert!(networks.is_empty() && generations == 200, "{}", cell.name);
                        }
                        "actiondelta" => assert_eq!(networks, [NetworkName::ActionDelta], "{}", cell.name),
                        "residact" => assert_eq!(networks, [NetworkName::ResidAct], "{}", cell.name),
                        other => panic!("{}: {other}", cell.name),
                    }
                    if modification != "fricarm" {
                        assert!(kinds.is_empty(), "{}", cell.name);
                        // Full: all weights from zero, one network a joint, as the paper has it.
                        let rule = &config.adapt.network[0];
                        let entries =
                            config.adapt.rules().theta(&config.adapt.groups(&joints), &joints, &[0.0; 12]);
                        let count = entries.unwrap().entries().len();
                        let networks = if scenario == "spring" { 1 } else { 12 };
                        if full {
                            assert_eq!((rule.lower, rule.upper, rule.deviation), (-1.0, 1.0, 0.25));
                            let scale = if modification == "residact" { 10.0 } else { 1.0 };
                            assert_eq!((count, rule.output_scale), (97 * networks, scale), "{}", cell.name);
                        } else {
                            assert_eq!(count, if scenario == "spring" { 5 } else { 15 }, "{}", cell.name);
                        }
                        // As many numbers squared are too many to be decomposed in every generation.
                        let separable = config.adapt.optimizer.covariance == CovarianceKind::Separable;
                        assert_eq!(separable, full && networks > 1, "{}", cell.name);
                        let small = if scenario == "spring" { 100 } else { 200 };
                        assert_eq!(generations, if full { 10_000 } else { small }, "{}", cell.name);
                    }
                    let theta = config
                        .adapt
                        .rules()
                        .theta(&config.adapt.groups(&joints), &joints, &[0.0; 12])
                        .unwrap();
                    let fitted: BTreeSet<&String> =
                        theta.entries().iter().flat_map(|entry| entry.joints.iter()).collect();
                    if scenario == "spring" {
                        assert_eq!(
                            fitted.into_iter().collect::<Vec<_>>(),
                            ["RR_calf_joint"],
                            "{}",
                            cell.name
                        );
                    } else {
                        assert_eq!(fitted.len(), 12, "{}", cell.name);
                    }
                    assert_eq!(config.evaluate.trajectories, if full { 10_000 } else { 2000 });
                    if full {
                        let (simulation, optimizer) = (&config.adapt.simulation, &config.adapt.optimizer);
                        assert_eq!((simulation.skip_seconds, simulation.horizon_seconds), (Some(0.0), 0.0));
                        assert!(optimizer.population == 0 && config.adapt.number.is_empty(), "{}", cell.name);
                    }
                }
            }
        }
        // No file is left that no table runs.
        for entry in std::fs::read_dir(folder()).unwrap() {
            let stem = entry.unwrap().path().file_stem().unwrap().to_string_lossy().into_owned();
            let scenario = ["model-shift-", "spring-", "noise-"].iter().any(|start| stem.starts_with(start));
            assert!(!scenario || read_files.contains(&stem), "{stem}");
        }
    }

    #[test]
    fn seeds_change_what_is_drawn_and_not_what_is_measured() {
        let paper = Paper::read().unwrap();
        let table = paper.table("spring").unwrap();
        let sets = ["adapt.optimizer.seeds=2", "adapt.optimizer.replicates=3"].map(ToOwned::to_owned);
        let experiments = read(&paper, table, &folder(), false, &sets, Some("*-residact-wass")).unwrap();
        let one = experiments.iter().find(|one| one.selected).unwrap();
        let (first, third) = (one.seeded(1), one.seeded(3));
        assert_eq!(first, one.config);
        assert_eq!(first.adapt.optimizer.replicates, 3, "--set asks for more than the paper's method");
        assert_eq!(third.target.unwrap().seed, first.target.unwrap().seed + 2);
        assert_eq!(third.adapt.optimizer.seed, first.adapt.optimizer.seed + 4);
        assert_eq!(third.finetune.seeds, [3]);
        assert_eq!(third.evaluate, first.evaluate);
        assert!(
            shared(&experiments, "spring", 1).unwrap().adapt.costs.iter().any(|cost| cost.is_privileged())
        );
    }

    #[test]
    fn trainings_of_a_scenario_have_seeds_of_their_own_and_the_simulation_of_the_cells() {
        let paper = Paper::read().unwrap();
        let table = paper.table("spring").unwrap();
        let sets = [
            "finetune.seeds=[1, 4]",
            "adapt.simulation.robot_timestep=0.002",
            "adapt.simulation.self_contact=[['*_foot', '*_foot']]",
        ];
        let sets = sets.map(ToOwned::to_owned);
        let mut experiments = read(&paper, table, &folder(), false, &sets, None).unwrap();
        assert_eq!(experiments[0].seeded(2).finetune.seeds, [5, 8]);
        let simulation = shared(&experiments, "spring", 1).unwrap().adapt.simulation;
        assert_eq!(simulation.robot_timestep, Some(0.002));
        assert_eq!(simulation.self_contact, experiments[0].config.adapt.simulation.self_contact);
        assert!(simulation.self_contact.is_some());
        experiments[1].config.adapt.simulation.robot_timestep = None;
        let refused = check_shared(&experiments[0], &experiments[1]).unwrap_err().to_string();
        assert!(refused.contains("adapt.simulation.robot_timestep"), "{refused}");
    }
}
