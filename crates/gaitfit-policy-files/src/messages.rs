//! Files of other kinds in the place of a description.

/// Names the kind of a table without anything of a policy's description, and the command or option that takes
/// it.
pub(super) fn other_kind(table: &toml::Table) -> Option<&'static str> {
    let has = |key: &str| table.contains_key(key);
    // A table with one of these is meant as a description: its own error tells what is missing.
    if has("file") || has("joints") || has("observation") {
        return None;
    }
    if table.is_empty() {
        return Some("it is empty; a description of a policy has at least `file` (docs/policies.md)");
    }
    if has("format") && (has("parameter") || has("cost_name")) {
        return Some(
            "it holds fitted parameters, not a policy: give it as --theta, and the policy as POLICY",
        );
    }
    if has("finetune") || has("adapt") || has("target") {
        return Some("it is the configuration of a loop, not a policy: run `gaitfit loop` with it");
    }
    if has("costs") || has("parameter") || has("optimizer") {
        return Some("it is the configuration of a fit, not a policy: run `gaitfit fit` with it");
    }
    if has("ppo") || has("train") {
        return Some("it is the configuration of a training, not a policy: run `gaitfit train` with it");
    }
    if has("slots") || has("motors") || has("topics") {
        return Some("it describes a robot or its topics, not a policy");
    }
    None
}
