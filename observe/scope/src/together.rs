//! Several running programs that are shown together.

use crate::merge::{Merge, Place};
use crate::scope::Shared;
use crate::store::Recording;
use luna_logger::format::Record;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// See [`Together::silence`].
const SILENCE: Duration = Duration::from_secs(1);

/// The programs that are there, and what they are shown as.
#[derive(Debug)]
pub(crate) struct Together {
    programs: Mutex<Programs>,
    /// After this silence a program counts as killed, if another of its name begins.
    silence: Duration,
}

#[derive(Debug)]
struct Programs {
    merge: Merge,
    recording: Recording,
}

impl Together {
    pub(crate) fn new() -> Self {
        let programs = Mutex::new(Programs {
            merge: Merge::default(),
            recording: Recording::NONE,
        });
        let silence = SILENCE;
        Self { programs, silence }
    }

    fn programs(&self) -> MutexGuard<'_, Programs> {
        let programs = self.programs.lock();
        programs.unwrap_or_else(PoisonError::into_inner)
    }

    /// Shows what all programs have reported until now, and what has waited for a silent one.
    pub(crate) fn release(&self, shared: &Shared) {
        let Programs { merge, recording } = &mut *self.programs();
        let until = merge.complete_until(Instant::now());
        merge.release(until, &mut |record| shared.store().take(*recording, record));
    }

    /// Shows all that has come.
    pub(crate) fn release_all(&self, shared: &Shared) {
        let Programs { merge, recording } = &mut *self.programs();
        merge.release(u64::MAX, &mut |record| {
            shared.store().take(*recording, record);
        });
    }
}

/// A program while its recording comes. Its end is that of this value.
pub(crate) struct Member<'a> {
    shared: &'a Shared,
    together: &'a Together,
    place: Option<Place>,
}

impl<'a> Member<'a> {
    pub(crate) fn new(shared: &'a Shared, together: &'a Together) -> Self {
        Self {
            shared,
            together,
            place: None,
        }
    }

    /// What the programs are shown as.
    pub(crate) fn recording(&self) -> Recording {
        self.together.programs().recording
    }

    pub(crate) fn take(&mut self, record: &Record<'_>) {
        let Programs { merge, recording } = &mut *self.together.programs();
        let shared = self.shared;
        if let (None, Record::Session { system, clock, .. }) = (self.place, record) {
            if !merge.is_live() {
                // All have ended: another run begins.
                *merge = Merge::default();
                *recording = shared.store().begin();
            }
            let recording = *recording;
            let mut out = |record: &Record<'_>| shared.store().take(recording, record);
            self.place = merge.begin(system, *clock, self.together.silence, &mut out);
            if self.place.is_none() {
                let problem = format!("{system} is not shown: there are too many programs");
                shared.store().fail(recording, problem);
            }
        }
        let Some(place) = self.place else { return };
        let now = Instant::now();
        let mut out = |record: &Record<'_>| shared.store().take(*recording, record);
        merge.take(place, record, &mut out);
        merge.hear(place, now);
        merge.release(merge.complete_until(now), &mut out);
    }
}

impl Drop for Member<'_> {
    fn drop(&mut self) {
        let Some(place) = self.place else { return };
        let Programs { merge, recording } = &mut *self.together.programs();
        merge.end(place);
        if !merge.is_live() {
            merge.finish(&mut |record| self.shared.store().take(*recording, record));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::Settings;
    use luna_logger::format::{ClockBase, Event};

    struct Given(Shared);

    impl Given {
        fn new() -> Self {
            let mut shared = Shared::new(Settings::default().together());
            let silence = Duration::MAX;
            let programs = shared.together.take().unwrap().programs;
            shared.together = Some(Together { programs, silence });
            Self(shared)
        }

        fn begin(&self, system: &str) -> Member<'_> {
            let mut member = Member::new(&self.0, self.0.together.as_ref().unwrap());
            member.take(&Record::Session {
                system,
                clock: ClockBase::Monotonic,
                written_by: "a test",
            });
            member
        }

        /// How many cycles of loops are shown, and of how many loops.
        fn cycles(&self) -> (u64, usize) {
            let together = self.0.together.as_ref().unwrap();
            together.release_all(&self.0);
            let loops = self.0.store().loops().json();
            let loops = loops["loops"].as_array().unwrap();
            let counts = loops.iter().map(|one| one["count"].as_u64().unwrap());
            (counts.sum(), loops.len())
        }
    }

    fn cycle(member: &mut Member<'_>, time: u64) {
        member.take(&Record::Event(Event {
            thread: 1,
            time,
            code: 10,
            subject: 1,
            arguments: [time, 0],
        }));
    }

    #[test]
    fn programs_are_added_until_all_have_ended() {
        let given = Given::new();
        let mut left = given.begin("left");
        let mut right = given.begin("right");
        cycle(&mut left, 1);
        cycle(&mut right, 2);
        assert_eq!(given.cycles(), (2, 2));
        // One that has ended, and comes again while others are there, goes on.
        right.take(&Record::End { time: 3 });
        let mut again = given.begin("right");
        cycle(&mut again, 4);
        drop(right);
        cycle(&mut again, 5);
        assert_eq!(given.cycles(), (4, 2));
        // A second one of a name is another.
        let mut second = given.begin("left");
        cycle(&mut second, 6);
        assert_eq!(given.cycles(), (5, 3));
        drop((left, again, second));
        // All have ended: the next one begins anew.
        let mut next = given.begin("left");
        cycle(&mut next, 7);
        assert_eq!(given.cycles(), (1, 1));
    }
}
