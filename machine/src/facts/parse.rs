//! Parsers of the kernel's files: pure functions, so that other machines' files can be tested on
//! this one.

use super::PreemptionModel;

/// Reads a list of cores or nodes as the kernel writes it, `0-3,8,10-11`; an empty one is a list
/// without members.
///
/// Ascending, without doubles. `None` if it is no such list: a range backwards, a number above
/// 65535, or anything else.
///
/// ```
/// use luna_machine::facts::parse::core_list;
///
/// assert_eq!(core_list("0-3,8,10-11\n"), Some(vec![0, 1, 2, 3, 8, 10, 11]));
/// assert_eq!(core_list("\n"), Some(vec![]));
/// assert_eq!(core_list("3-1"), None);
/// ```
pub fn core_list(text: &str) -> Option<Vec<usize>> {
    let text = text.trim();
    // Some kernels write `(null)` for a mask that was never made.
    if text.is_empty() || text == "(null)" {
        return Some(Vec::new());
    }
    let mut cores = Vec::new();
    for part in text.split(',') {
        let (first, last) = part.split_once('-').unwrap_or((part, part));
        // Sixteen bits: no kernel has more cores, and a mistaken range takes little memory.
        let (first, last) = (
            first.trim().parse::<u16>().ok()?,
            last.trim().parse::<u16>().ok()?,
        );
        if first > last {
            return None;
        }
        cores.extend((first..=last).map(usize::from));
    }
    cores.sort_unstable();
    cores.dedup();
    Some(cores)
}

/// Writes ascending numbers as the kernel does; `none` if there are none.
///
/// ```
/// assert_eq!(luna_machine::facts::parse::write_core_list(&[0, 1, 2, 5, 7, 8]), "0-2,5,7-8");
/// ```
pub fn write_core_list(cores: &[usize]) -> String {
    if cores.is_empty() {
        return "none".to_owned();
    }
    let parts = cores.chunk_by(|before, after| *after == before.saturating_add(1));
    let parts = parts.map(|run| match run {
        [first, .., last] => format!("{first}-{last}"),
        _ => run.iter().map(usize::to_string).collect(),
    });
    parts.collect::<Vec<_>>().join(",")
}

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
    fn lists_with_gaps_and_without_order() {
        for (text, cores) in [
            ("0", vec![0]),
            ("0-1\n", vec![0, 1]),
            ("0-3,8,10-11", vec![0, 1, 2, 3, 8, 10, 11]),
            ("4,0-1,1", vec![0, 1, 4]),
            ("", vec![]),
            (" (null)\n", vec![]),
            ("0-255", (0..256).collect()),
        ] {
            assert_eq!(core_list(text), Some(cores), "{text:?}");
        }
    }

    #[test]
    fn no_lists() {
        for text in [
            "x",
            "1-",
            "-1",
            "1,,2",
            "3-1",
            "1-2-3",
            "0-4294967295",
            "0:3",
            "1 2",
        ] {
            assert_eq!(core_list(text), None, "{text:?}");
        }
    }

    #[test]
    fn lists_and_back() {
        for text in ["0", "0-1", "0,2", "0-3,8,10-11", "5,7-9"] {
            assert_eq!(write_core_list(&core_list(text).unwrap()), text);
        }
        assert_eq!(write_core_list(&[]), "none");
    }

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
