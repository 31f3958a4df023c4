//! What one process leaves in a recording.

use super::Recorder;
use crate::event::{CUT, CUT_WITHIN, ENDED, Head, zigzag};
use luna_core::current;
use luna_core::replay_log::{About, Event, ReplayLog, Turn, What};
use luna_events::ByteRing;
use std::cell::Cell;
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::task::{Context, Poll};

/// Highest number of distinct branches of a process, the process itself among them.
const MAX_BRANCH_LOGS: usize = 64;

/// The recorder of one process. Its room is there when the process begins; nothing of it allocates
/// or waits after that.
pub(crate) struct Track {
    recorder: Arc<Recorder>,
    ring: Arc<ByteRing>,
    branch_logs: [BranchLog; MAX_BRANCH_LOGS],
    /// The stamp that the current operation has taken.
    own_stamp: Cell<u64>,
    /// The current operation takes a stamp in any case.
    takes: Cell<bool>,
    last_time: Cell<u64>,
    has_ended: Cell<bool>,
    /// Number of operations begun by all branch logs.
    begun: Cell<u64>,
    number: u32,
}

/// The branch log of one branch of a process.
#[derive(Default)]
struct BranchLog {
    path: Cell<u32>,
    is_used: Cell<bool>,
    operations: Cell<u64>,
    /// The operation of its last event.
    noted: Cell<u64>,
    /// The index of its last operation among the process' operations.
    begun: Cell<u64>,
    runs: Cell<bool>,
    is_call: Cell<bool>,
}

impl Track {
    pub(super) fn new(recorder: Arc<Recorder>, ring: Arc<ByteRing>, number: u32) -> Self {
        Self {
            recorder,
            ring,
            branch_logs: std::array::from_fn(|_| BranchLog::default()),
            own_stamp: Cell::new(0),
            takes: Cell::new(false),
            last_time: Cell::new(0),
            has_ended: Cell::new(false),
            begun: Cell::new(0),
            number,
        }
    }

    fn here(&self) -> Option<&BranchLog> {
        let path = current::branch_path();
        if path == 0 {
            return Some(&self.branch_logs[0]);
        }
        for branch_log in &self.branch_logs[1..] {
            if !branch_log.is_used.get() {
                branch_log.is_used.set(true);
                branch_log.path.set(path);
            }
            if branch_log.path.get() == path {
                return Some(branch_log);
            }
        }
        self.ring.lose();
        None
    }

    fn begin(&self, branch_log: &BranchLog, is_call: bool) {
        branch_log.operations.set(branch_log.operations.get() + 1);
        self.begun.set(self.begun.get() + 1);
        branch_log.begun.set(self.begun.get());
        branch_log.runs.set(true);
        branch_log.is_call.set(is_call);
    }

    fn head(branch_log: &BranchLog, code: u8) -> Head {
        let later =
            branch_log.operations.get() - branch_log.noted.replace(branch_log.operations.get());
        Head::new(code, branch_log.is_call.get(), branch_log.path.get(), later)
    }

    /// The process has returned, or the framework has ended it in the middle of an operation.
    pub(crate) fn end(&self) {
        if self
            .branch_logs
            .iter()
            .any(|branch_log| branch_log.runs.get())
        {
            return self.cut();
        }
        if !self.has_ended.replace(true) {
            self.last(&self.branch_logs[0], ENDED, false);
            self.ring.close();
        }
    }

    /// Its body is gone: if it has not returned, it was ended. Each branch log records how far it
    /// had come: a replay is to go there, and no further.
    pub(crate) fn cut(&self) {
        if self.has_ended.replace(true) {
            return;
        }
        let begun = self.begun.get();
        let used = self.branch_logs[1..]
            .iter()
            .filter(|branch_log| branch_log.is_used.get());
        for branch_log in used.chain([&self.branch_logs[0]]) {
            match branch_log.runs.get() {
                true => self.last(branch_log, CUT_WITHIN, false),
                // If another branch log has done something since, the process may have gone on to
                // that: as into a parallel construct, or out of it.
                false => self.last(branch_log, CUT, branch_log.begun.get() < begun),
            }
        }
        self.ring.close();
    }

    fn last(&self, branch_log: &BranchLog, code: u8, has_gone_on: bool) {
        branch_log.is_call.set(has_gone_on);
        self.ring.put(Self::head(branch_log, code).get(), &[]);
    }
}

impl ReplayLog for Track {
    fn enter(&self, _: &mut Context<'_>) -> Poll<Turn> {
        self.own_stamp.set(0);
        self.takes.set(false);
        if let Some(branch_log) = self.here()
            && !branch_log.runs.get()
        {
            self.begin(branch_log, false);
        }
        Poll::Ready(Turn::Record)
    }

    fn call(&self, takes: bool) -> Turn {
        self.own_stamp.set(0);
        self.takes.set(takes);
        if let Some(branch_log) = self.here() {
            self.begin(branch_log, true);
        }
        Turn::Record
    }

    fn is_replay(&self) -> bool {
        false
    }

    fn leave(&self, event: Event) {
        self.takes.set(false);
        let Some(branch_log) = self.here() else {
            return;
        };
        if !branch_log.runs.replace(false) {
            return;
        }
        if event.what == What::Done && event.stamp == 0 && !branch_log.is_call.get() {
            return;
        }
        let mut head = Self::head(branch_log, event.what as u8);
        match event.what {
            What::Done => head.number(event.stamp),
            What::Failed => head.number(event.number),
            What::TimedOut => {}
            What::Chosen => {
                head.number(event.number);
                head.number(event.stamp);
            }
            What::Time => head.number(zigzag(self.last_time.replace(event.number), event.number)),
        }
        self.ring.put(head.get(), &[]);
    }

    fn abandon(&self, was_let_in: bool) {
        // A recorded operation is let in at once.
        if was_let_in && let Some(branch_log) = self.here() {
            branch_log.runs.set(false);
        }
    }

    fn hold(&self, _: &mut Context<'_>) -> Poll<()> {
        Poll::Ready(())
    }

    fn stamp(&self, several: bool) -> u64 {
        if !several && !self.takes.get() {
            return 0;
        }
        let stamp = self.recorder.stamps.fetch_add(1, Ordering::Relaxed);
        if self.own_stamp.get() == 0 {
            self.own_stamp.set(stamp);
        }
        stamp
    }

    fn own_stamp(&self) -> u64 {
        self.own_stamp.get()
    }

    fn put(&self, about: About, name: u32, bytes: &[u8]) {
        let Some(branch_log) = self.here() else {
            return;
        };
        if !branch_log.runs.get() {
            self.begin(branch_log, true);
        }
        branch_log.runs.set(false);
        let mut head = Self::head(branch_log, about as u8);
        head.number(u64::from(name));
        head.number(bytes.len() as u64);
        self.ring.put(head.get(), bytes);
    }

    fn get(&self, _: About, _: u32, _: &mut [u8]) -> Option<usize> {
        None
    }

    fn branch_log(&self) -> u32 {
        (self.number.wrapping_mul(0x9e37_79b1) ^ current::branch_path()).max(1)
    }

    fn process(&self) -> u32 {
        self.number
    }

    fn outside(&self, construct: &'static str) {
        self.ring.note_outside(construct);
    }

    fn settle(&self, _: &mut Context<'_>) -> Poll<()> {
        Poll::Ready(())
    }

    fn differs(&self, _: &'static str) {}
}
