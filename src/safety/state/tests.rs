use super::*;
use crate::safety::Emergency;
use std::sync::Weak;

#[test]
fn an_emergency_by_a_crash_needs_no_lock() {
    let emergency = Emergency::new(Weak::new());
    // A crashed thread holds it. One more lock by this thread would panic.
    let _book = emergency.journal.book.lock();
    emergency.begin_for_crash();
    assert_eq!(emergency.journal.degree(), Degree::Emergency);
    assert!(emergency.has_begun());
}

#[test]
fn what_is_latched_is_known_when_no_more_events_are_kept() {
    let journal = Journal::new();
    let note = |degree, text: &str| {
        let cause = Cause::Raised(Error::Panicked(text.to_owned()));
        journal.note(degree, cause, || true);
    };
    for number in 0..KEPT + 3 {
        note(Degree::Warning, &number.to_string());
    }
    let shown = || journal.state().to_string();
    assert_eq!(shown(), "warning: panicked: 0");
    note(Degree::SafeState, "first");
    note(Degree::SafeState, "second");
    assert_eq!(shown(), "safe state: panicked: first");
    assert_eq!(journal.state().more_events, 5);
    let before = journal.state();
    journal.reset(Error::Timeout, || true).unwrap();
    assert_eq!(
        (journal.state().degree, journal.state().latched),
        (Degree::Normal, None)
    );
    note(Degree::SafeState, "anew");
    assert_eq!(shown(), "safe state: panicked: anew");
    note(Degree::Emergency, "at last");
    let emergency = journal.emergency().unwrap();
    assert_eq!(emergency.to_string(), "emergency: panicked: at last");
    // What was read stays as it was.
    assert_eq!(before.to_string(), "safe state: panicked: first");
    assert_eq!(journal.state().events, before.events);
}

#[test]
fn one_signal_is_noted_once_whichever_hears_of_it() {
    let journal = Journal::new();
    for number in [15, 15, 2] {
        journal.note(Degree::Emergency, Cause::Signal(number), || true);
    }
    assert_eq!(journal.state().events.len(), 2);
    assert_eq!(journal.state().to_string(), "stopped by SIGTERM");
}

fn reported(journal: &Journal) -> Vec<Degree> {
    journal.reported.lock().unwrap().clone()
}

#[test]
fn a_crash_is_told_when_it_is_noted_and_what_changes_nothing_is_not() {
    let emergency = Emergency::new(Weak::new());
    let journal = &emergency.journal;
    let note = |degree, cause| journal.note(degree, cause, || true);
    note(Degree::SafeState, Cause::Panic);
    note(Degree::Warning, Cause::Panic);
    note(Degree::SafeState, Cause::Panic);
    assert_eq!(reported(journal), [Degree::SafeState]);
    emergency.begin_for_crash();
    note(Degree::Emergency, Cause::Signal(11));
    note(Degree::Emergency, Cause::Panic);
    assert_eq!(reported(journal), [Degree::SafeState, Degree::Emergency]);
}

#[test]
fn what_is_told_last_is_what_it_is() {
    let journal = Journal::new();
    std::thread::scope(|scope| {
        for _ in 0..3 {
            scope.spawn(|| {
                for _ in 0..1000 {
                    journal.note(Degree::SafeState, Cause::Panic, || true);
                    journal.reset(Error::Timeout, || true).unwrap();
                }
            });
        }
        scope.spawn(|| {
            for _ in 0..1000 {
                let book = journal.book.lock();
                let last = reported(&journal).last().copied();
                assert_eq!(last.unwrap_or_default(), journal.degree());
                drop(book);
            }
        });
    });
}
