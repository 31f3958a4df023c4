//! What a bus counts.

use luna::time::{FollowState, Followed};
use std::sync::atomic::{AtomicI64, AtomicU8, AtomicU64, Ordering};

macro_rules! counters {
    ($($(#[$about:meta])* $name:ident),+ $(,)?) => {
        /// Counters of a bus. They can be read at any time, from any thread.
        #[derive(Debug, Default)]
        pub struct Health {
            $(pub(crate) $name: Counter,)+
            clock: ClockHealth,
        }

        impl Health {
            $($(#[$about])* pub fn $name(&self) -> u64 { self.$name.0.load(Ordering::Relaxed) })+
        }
    };
}

counters! {
    /// Cycles.
    cycles,
    /// Cycles without an answer in time.
    missed,
    /// The most cycles in a row without an answer in time, or with a wrong working counter. Those
    /// before OP in which all subdevices answered are left out.
    longest_silence,
    /// Cycles with a wrong working counter, or without all states: a subdevice did not take part.
    /// Before OP too, where some take no outputs.
    miscounted,
    /// Frames that came and were not used: the answers to earlier cycles and to the frames that make
    /// the bus safe, doubled, foreign, or malformed ones.
    dropped,
    /// Frames that the system refused to send, or errors that it returned in place of one.
    refused,
}

/// Written by one process.
#[derive(Debug, Default)]
pub(crate) struct Counter(AtomicU64);

impl Counter {
    pub(crate) fn add(&self) {
        self.0
            .store(self.0.load(Ordering::Relaxed) + 1, Ordering::Relaxed);
    }

    pub(crate) fn raise_to(&self, value: u64) {
        if value > self.0.load(Ordering::Relaxed) {
            self.0.store(value, Ordering::Relaxed);
        }
    }
}

#[derive(Debug, Default)]
struct ClockHealth {
    state: AtomicU8,
    phase_error: AtomicI64,
    /// Parts per billion.
    rate: AtomicI64,
}

impl Health {
    /// How the bus' loop stands to the reference clock. `Acquiring` if it does not follow one.
    pub fn clock(&self) -> FollowState {
        match self.clock.state.load(Ordering::Relaxed) {
            1 => FollowState::Locked,
            2 => FollowState::FreeRunning,
            _ => FollowState::Acquiring,
        }
    }

    /// By how much the loop's last measured slot came after that of the reference clock (ns); 0 if
    /// none was measured.
    pub fn phase_error(&self) -> i64 {
        self.clock.phase_error.load(Ordering::Relaxed)
    }

    /// By how much a second of the reference clock is longer than one of this computer, in parts
    /// per million.
    pub fn rate_ppm(&self) -> f64 {
        self.clock.rate.load(Ordering::Relaxed) as f64 * 1e-3
    }

    pub(crate) fn note_clock(&self, followed: &Followed, rate_ppm: f64) {
        let state = match followed.state {
            FollowState::Locked => 1,
            FollowState::FreeRunning => 2,
            _ => 0,
        };
        let ordering = Ordering::Relaxed;
        self.clock.state.store(state, ordering);
        self.clock.rate.store((rate_ppm * 1e3) as i64, ordering);
        if let Some(error) = followed.phase_error {
            self.clock.phase_error.store(error, ordering);
        }
    }
}
