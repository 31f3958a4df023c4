//! The part of the report on safety.

use super::emergency::{FunctionOutcome, FunctionReport};
use super::state::{Degree, SafetyState};
use std::fmt;

/// How safe a system was, and how it went with its functions, in
/// [`Report::safety`](crate::Report::safety).
///
/// ```
/// use luna::prelude::*;
/// use luna::report::FunctionOutcome;
/// use luna::safety::Degree;
///
/// let mut system = System::new("arm");
/// system.on_emergency("brakes", || { /* engage them */ });
/// let main = system.executor("main").build()?;
/// main.process("encoder").spawn(async { Err(luna::emergency(luna::Error::other("no index pulse"))) })?;
/// system.run().unwrap_err();
/// let safety = system.report().unwrap().safety;
/// assert_eq!(safety.state.degree, Degree::Emergency);
/// assert_eq!(safety.functions[0].outcome, FunctionOutcome::Ran);
/// # Ok::<(), luna::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct SafetyReport {
    /// What was reported, and what is latched at the end.
    pub state: SafetyState,
    /// The functions of [`on_emergency`](crate::System::on_emergency), in their order.
    pub functions: Vec<FunctionReport>,
    /// Those of [`on_safe_state`](crate::System::on_safe_state), of the last time.
    pub safe_state_functions: Vec<FunctionReport>,
}

impl SafetyReport {
    /// The functions of both kinds that did not run to their end as they should, or for which no
    /// thread was left.
    pub fn failed(&self) -> impl Iterator<Item = &FunctionReport> {
        let all = self.functions.iter().chain(&self.safe_state_functions);
        all.filter(|one| {
            one.no_thread_left
                || matches!(
                    one.outcome,
                    FunctionOutcome::Panicked | FunctionOutcome::LeftBehind
                )
        })
    }
}

impl fmt::Display for SafetyReport {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.state.degree == Degree::Normal {
            return Ok(());
        }
        writeln!(f, "safety: {}", self.state)?;
        let all = self.functions.iter().chain(&self.safe_state_functions);
        let was_due =
            |one: &&FunctionReport| one.outcome != FunctionOutcome::NotRun || one.no_thread_left;
        for function in all.filter(was_due) {
            writeln!(f, "  function {function}")?;
        }
        Ok(())
    }
}
