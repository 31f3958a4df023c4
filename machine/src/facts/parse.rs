//! Parsers of the kernel's files: pure functions, so that other machines' files can be tested on
//! this one.

use super::PreemptionModel;

pub use luna_platform::thread::{core_list, write_core_list};

/// The kernel's version, from `/proc/sys/kernel/osrelease`: its first two numbers.
///
/// ```
/// assert_eq!(luna_machine::facts::parse::kernel_version("6.1.0-56-rt-amd64"), Some((6, 1)));
/// ```
pub fn kernel_version(release: &str) -> Option<(u32, u32)> {
    let mut numbers = release.trim().split(['.', '-', '+', '~']);
    Some((numbers.next()?.parse().ok()?, numbers.next()?.parse().ok()?))
}

/// The preemption model that the kernel was built with, from its version line (`uname -v`).
///
/// Since Linux 5.12 a kernel can choose when it boots: then this is [`PreemptionModel::Dynamic`],
/// and [`preemption_in_effect`] knows more where its file can be read.
///
/// ```
/// use luna_machine::facts::{PreemptionModel, parse::preemption_of_version};
///
/// assert_eq!(preemption_of_version("#1 SMP PREEMPT_RT Debian 6.12.9-1"), PreemptionModel::RealTime);
/// ```
pub fn preemption_of_version(version: &str) -> PreemptionModel {
    // Kernels patched before 5.4 write `PREEMPT RT`.
    let has = |flag: &str| {
        version
            .split([' ', '_'])
            .collect::<Vec<_>>()
            .windows(2)
            .any(|two| two.join("_") == flag)
    };
    if has("PREEMPT_RT") {
        PreemptionModel::RealTime
    } else if has("PREEMPT_DYNAMIC") {
        PreemptionModel::Dynamic
    } else if has("PREEMPT_LAZY") {
        PreemptionModel::Lazy
    } else if version.split(' ').any(|word| word == "PREEMPT") {
        PreemptionModel::Full
    } else {
        PreemptionModel::NoneOrVoluntary
    }
}

/// The preemption model in effect, from `/sys/kernel/debug/sched/preempt`: the word in parentheses.
///
/// ```
/// use luna_machine::facts::{PreemptionModel, parse::preemption_in_effect};
///
/// assert_eq!(preemption_in_effect("none voluntary (full) lazy"), Some(PreemptionModel::Full));
/// assert_eq!(preemption_in_effect("none voluntary full"), None);
/// ```
pub fn preemption_in_effect(text: &str) -> Option<PreemptionModel> {
    let word = text
        .split_whitespace()
        .find_map(|word| word.strip_prefix('(')?.strip_suffix(')'))?;
    preemption_word(word)
}

/// The preemption model asked for on the kernel's command line, `preempt=full`; the last one
/// counts.
///
/// ```
/// use luna_machine::facts::{PreemptionModel, parse::preemption_asked};
///
/// assert_eq!(preemption_asked("root=/dev/sda preempt=lazy quiet"), Some(PreemptionModel::Lazy));
/// assert_eq!(preemption_asked("quiet"), None);
/// ```
pub fn preemption_asked(command_line: &str) -> Option<PreemptionModel> {
    let words = command_line.split_whitespace();
    words
        .filter_map(|word| word.strip_prefix("preempt="))
        .next_back()
        .and_then(preemption_word)
}

/// A core's line of `/proc/stat`: the core, and how many ticks a hypervisor has taken from it.
/// `None` for every other line.
///
/// ```
/// use luna_machine::facts::parse::stolen_ticks;
///
/// assert_eq!(stolen_ticks("cpu1 10 0 20 3000 4 0 5 67 0 0"), Some((1, 67)));
/// assert_eq!(stolen_ticks("cpu  10 0 20 3000 4 0 5 67 0 0"), None); // all of them together
/// assert_eq!(stolen_ticks("ctxt 12345"), None);
/// ```
pub fn stolen_ticks(line: &str) -> Option<(usize, u64)> {
    let mut words = line.split_whitespace();
    let core = words.next()?.strip_prefix("cpu")?.parse().ok()?;
    // user, nice, system, idle, iowait, irq, softirq; kernels before 2.6.11 end there.
    let stolen = words.nth(7)?.parse().ok()?;
    Some((core, stolen))
}

fn preemption_word(word: &str) -> Option<PreemptionModel> {
    match word {
        "none" => Some(PreemptionModel::None),
        "voluntary" => Some(PreemptionModel::Voluntary),
        "full" => Some(PreemptionModel::Full),
        "lazy" => Some(PreemptionModel::Lazy),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn version_lines_of_distributions() {
        for (version, model) in [
            ("#1 SMP PREEMPT_DYNAMIC @0", PreemptionModel::Dynamic),
            (
                "#1 SMP PREEMPT_RT Debian 6.1.119-1 (2024-11-22)",
                PreemptionModel::RealTime,
            ),
            (
                "#1 SMP PREEMPT RT Mon Jan 1 2018",
                PreemptionModel::RealTime,
            ),
            ("#54-Ubuntu SMP PREEMPT Thu Nov 20", PreemptionModel::Full),
            ("#1 SMP PREEMPT_LAZY Thu Nov 20", PreemptionModel::Lazy),
            (
                "#1 SMP Debian 5.10.209-2 (2024-01-31)",
                PreemptionModel::NoneOrVoluntary,
            ),
            ("", PreemptionModel::NoneOrVoluntary),
        ] {
            assert_eq!(preemption_of_version(version), model, "{version}");
        }
    }

    #[test]
    fn the_model_in_effect() {
        assert_eq!(
            preemption_in_effect("(none) voluntary full lazy\n"),
            Some(PreemptionModel::None)
        );
        assert_eq!(
            preemption_in_effect("none (voluntary) full"),
            Some(PreemptionModel::Voluntary)
        );
        assert_eq!(
            preemption_in_effect("full (lazy)"),
            Some(PreemptionModel::Lazy)
        );
        assert_eq!(preemption_in_effect("(new) full"), None);
        assert_eq!(
            preemption_asked("preempt=full preempt=none"),
            Some(PreemptionModel::None)
        );
        assert_eq!(preemption_asked("preempt=other"), None);
    }
}
