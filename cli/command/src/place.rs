//! Where the measured processes run.

use crate::values::policy;
use clap::Args;
use luna::{Policy, System};
use luna_machine::facts::{Source, parse::core_list};
use luna_platform::thread::available_cores;

/// Where the measured processes run, and how they are reported.
#[derive(Debug, Clone, Args)]
pub struct Placement {
    /// The core to run on [default: the last isolated one, else the last]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub core: Option<usize>,
    /// The scheduling policy: fifo:PRIORITY, rr:PRIORITY (1 to 97) or other
    #[arg(long, default_value = "fifo:80", value_parser = policy)]
    pub policy: Policy,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub json: bool,
}

/// The executor `name`, placed as asked for; without a core, on the one that [`quietest`] finds.
pub fn executor(
    system: &mut System,
    name: &str,
    place: &Placement,
) -> luna::Result<luna::Executor> {
    executor_under(system, name, place, place.policy)
}

/// As [`executor`], under another policy.
pub fn executor_under(
    system: &mut System,
    name: &str,
    place: &Placement,
    policy: Policy,
) -> luna::Result<luna::Executor> {
    let mut executor = system.executor(name).policy(policy);
    if let Some(core) = place.core.or_else(quietest_here) {
        executor = executor.core(core);
    }
    executor.build()
}

fn quietest_here() -> Option<usize> {
    let isolated = Source::machine().parse("/sys/devices/system/cpu/isolated", core_list);
    quietest(&available_cores(), &isolated.unwrap_or_default())
}

/// The last isolated one of the cores that this process may use, else the last one: interrupts tend
/// to go to the first.
pub fn quietest(allowed: &[usize], isolated: &[usize]) -> Option<usize> {
    let quiet = allowed.iter().rev().find(|core| isolated.contains(core));
    quiet.or(allowed.last()).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn isolated_cores_come_first() {
        assert_eq!(quietest(&[0, 1, 2, 3], &[1, 2]), Some(2));
    }

    #[test]
    fn the_last_one_else() {
        assert_eq!(quietest(&[0, 5], &[]), Some(5));
        assert_eq!(quietest(&[0, 3], &[1, 2]), Some(3));
        assert_eq!(quietest(&[], &[1]), None);
    }
}
