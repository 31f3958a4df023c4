//! The tests that are left out in a guest, each with its reason.

use crate::arch::Arch;
use crate::build::Program;

/// Tests that are not run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct LeftOut {
    /// The package and the target of their program.
    program: (&'static str, &'static str),
    /// Where; `None` for both.
    arch: Option<Arch>,
    /// What their names have in common.
    pub(crate) name: &'static str,
    pub(crate) reason: &'static str,
}

const ALL: &[LeftOut] = &[
    LeftOut {
        program: ("luna-channels", "it"),
        arch: None,
        name: "compile_errors::",
        reason: "it calls the compiler, which the guest does not have",
    },
    LeftOut {
        program: ("luna-rt", "it"),
        arch: None,
        name: "docs::",
        reason: "it reads the checkout's pages, which the guest does not have",
    },
    LeftOut {
        program: ("luna-rt", "own"),
        arch: None,
        name: "a_wake_relies_on_no_other",
        reason: "with PREEMPT_RT a futex wake relies on other wakers: two_wakers shows it without LUNA",
    },
    LeftOut {
        program: ("luna-rt", "own"),
        arch: None,
        name: "fifo_80_beside_",
        reason: "with PREEMPT_RT a waker that loses the processor in its futex call keeps the wake: two_wakers shows it without LUNA",
    },
];

/// Those of a program.
pub(crate) fn of(arch: Arch, program: &Program) -> Vec<LeftOut> {
    let is_own = |test: &&LeftOut| {
        test.program == (&*program.package, &*program.target)
            && test.arch.is_none_or(|only| only == arch)
    };
    ALL.iter().filter(is_own).copied().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_has_a_name_that_a_shell_takes_as_one_word_and_a_reason() {
        for test in ALL {
            let is_plain = |c: char| c.is_ascii_alphanumeric() || "_:".contains(c);
            assert!(
                !test.name.is_empty() && test.name.chars().all(is_plain),
                "{test:?}"
            );
            assert!(!test.reason.is_empty(), "{test:?}");
        }
    }
}
