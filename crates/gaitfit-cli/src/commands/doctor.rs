//! `gaitfit doctor`: what this machine offers.

use crate::exit::Failure;
use crate::output;
use gaitfit::machine::machine;

/// Prints version, processor, vector instructions and threads.
pub fn run(args: &crate::cli::Doctor) -> Result<(), Failure> {
    let found = machine();
    if args.json {
        return output::print_json(&found);
    }
    let named = |text: &str| if text.is_empty() { "unknown".to_owned() } else { text.to_owned() };
    output::print(&format!(
        "gaitfit    {}\nplatform   {}\nprocessor  {}\nfeatures   {}\nengine     {}\nthreads    {}\n",
        found.gaitfit,
        found.platform,
        named(&found.processor),
        named(&found.features.join(", ")),
        found.engine,
        found.threads,
    ))
}
