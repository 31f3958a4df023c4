//! Which threads share a core: a thread that looks for work before it sleeps must not keep another
//! one of the system from running.
//!
//! User space does not see which threads wait for a core, so this module uses the plan. A thread
//! that is not pinned may come to any core, so it shares all of them.

use super::plan::{NamedThread, Placement, ProcessPlan, Running};
use crate::csp::composition::ThreadPart;
use crate::notice::notice;
use luna_core::ExecutorHandle;
use luna_platform::thread::Attributes;
use luna_platform::thread::SpinRefusal;

/// Why a thread on `core` is not to look for work before it sleeps: a neighbour, which is pinned to
/// `neighbours_core`, may want to run there.
fn refusal(
    core: Option<usize>,
    neighbour: &str,
    neighbours_core: Option<usize>,
) -> Option<SpinRefusal> {
    let neighbour = neighbour.to_owned();
    match (core, neighbours_core) {
        (None, _) => Some(SpinRefusal::NotPinned),
        (_, None) => Some(SpinRefusal::UnpinnedNeighbour { name: neighbour }),
        (Some(own), Some(other)) if own == other => {
            Some(SpinRefusal::SharedCore { with: neighbour })
        }
        _ => None,
    }
}

/// Refuses the threads of a system that is about to start what they cannot have beside each other.
/// O(threads²), and only for those that request it.
pub(super) fn settle(executors: &mut [Attributes], processes: &mut [ProcessPlan]) {
    let threads = processes
        .iter_mut()
        .filter_map(|process| match &mut process.place {
            Placement::Thread(attributes) => Some(&mut **attributes),
            Placement::Executor(_) => None,
        });
    let all: Vec<&mut Attributes> = executors.iter_mut().chain(threads).collect();
    let known = all
        .iter()
        .map(|one| (one.name().to_owned(), one.asked_core()));
    let known: Vec<_> = known.collect();
    for (index, attributes) in all.into_iter().enumerate() {
        if attributes.asked_spin().is_zero() {
            continue;
        }
        let mut others = (0..known.len()).filter(|other| *other != index);
        let why = others.find_map(|other| refusal(known[index].1, &known[other].0, known[other].1));
        if let Some(why) = why {
            *attributes = attributes.clone().refuse_spin(why);
        }
    }
}

/// A thread may come to those that have been started: refuses it what it cannot have beside them,
/// and takes from them what they cannot have beside it, which is reported on standard error.
pub(super) fn join(
    place: &mut Placement,
    running: &Running,
    parts: &[ThreadPart],
    threads: &[NamedThread],
) {
    if let Placement::Thread(attributes) = place
        && running.simulation.is_none()
    {
        join_those(attributes, &running.executors, parts, threads);
    }
}

fn join_those(
    attributes: &mut Attributes,
    executors: &[ExecutorHandle],
    parts: &[ThreadPart],
    threads: &[NamedThread],
) {
    let (core, name) = (attributes.asked_core(), attributes.name());
    let mut own = None;
    let mut meet = |other: &str, others_core, end_spin: &dyn Fn() -> bool| {
        if let Some(why) = refusal(core, other, others_core) {
            own.get_or_insert(why);
        }
        if refusal(others_core, name, core).is_some() && end_spin() {
            notice!(
                "luna: `{other}` looks for work before it sleeps no longer, since `{name}` may run on its core; pin that one to another core"
            );
        }
    };
    for (part, executor) in parts.iter().zip(executors) {
        meet(&part.name, part.core, &|| executor.end_spin());
    }
    for (other, thread) in threads.iter().filter(|(_, thread)| !thread.has_stopped()) {
        let others_core = thread.obtained().and_then(|obtained| obtained.core);
        meet(other, others_core, &|| thread.end_spin());
    }
    if let Some(why) = own {
        *attributes = attributes.clone().refuse_spin(why);
    }
}

#[cfg(all(test, target_os = "linux", not(luna_portable)))]
mod tests {
    use super::*;
    use crate::csp::composition::ThreadKind;
    use luna_core::{Executor, OsThread, ProcessSpec};
    use luna_platform::thread::{Refusal, available_cores};
    use std::time::Duration;

    const TIME: Duration = Duration::from_micros(20);

    /// An executor or an OS thread that looks for work before it sleeps, on `core`; and what the
    /// one that comes is refused.
    fn after_one_has_come(core: usize, comes: Attributes) -> [(bool, Option<Refusal>); 2] {
        let attributes = || Attributes::new("first").core(core).spin_before_sleep(TIME);
        let executor = Executor::start(attributes()).unwrap();
        let part = ThreadPart::obtained("first", ThreadKind::Executor, executor.obtained());
        let thread = OsThread::start(attributes(), ProcessSpec::new("first"), || async {}).unwrap();
        let refused = |attributes: Attributes| {
            let came = Executor::start(attributes).unwrap();
            came.obtained().unwrap().refusals.first().cloned()
        };

        let mut of_second = comes.clone();
        let executors = [executor.handle().clone()];
        join_those(&mut of_second, &executors, &[part], &[]);
        let with_executor = (executor.handle().end_spin(), refused(of_second));

        let mut of_second = comes;
        let threads = [("first".to_owned(), thread)];
        join_those(&mut of_second, &[], &[], &threads);
        [with_executor, (threads[0].1.end_spin(), refused(of_second))]
    }

    #[test]
    fn one_that_comes_later_ends_the_looking_of_those_whose_core_it_shares() {
        let core = available_cores()[0];
        let shared = |why| Some(Refusal::Spin { asked: TIME, why });
        let with = "first".to_owned();
        let comes = Attributes::new("second").core(core).spin_before_sleep(TIME);
        let refused = shared(SpinRefusal::SharedCore { with });
        assert_eq!(
            after_one_has_come(core, comes),
            [(false, refused.clone()), (false, refused)]
        );
        let comes = Attributes::new("second").spin_before_sleep(TIME);
        let refused = shared(SpinRefusal::NotPinned);
        assert_eq!(
            after_one_has_come(core, comes),
            [(false, refused.clone()), (false, refused)]
        );
        let unpinned = Attributes::new("second");
        assert_eq!(
            after_one_has_come(core, unpinned),
            [(false, None), (false, None)]
        );
    }

    #[test]
    fn one_that_comes_to_another_core_changes_nothing() {
        let [first, second, ..] = available_cores()[..] else {
            return;
        };
        let comes = Attributes::new("second")
            .core(second)
            .spin_before_sleep(TIME);
        assert_eq!(
            after_one_has_come(first, comes),
            [(true, None), (true, None)]
        );
    }
}
