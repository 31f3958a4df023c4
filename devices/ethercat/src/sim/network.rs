//! The simulated wire with its subdevices.

use super::esc::Esc;
use super::line::{Answer, Faults, Line, Time, WAITING};
use super::subdevice::SubDevice;
use crate::frame::MAX_FRAME;
use crate::{SdoValue, State};
use luna_platform::clock::Clock;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// A simulated EtherCAT network: a line of subdevices.
///
/// Clones are the same network, for a test that looks at it and injects faults while a bus uses it.
/// It is processed by the threads that call it, under a lock; so it is not for the real-time path.
///
/// It goes by the clock of the calling thread. A bus is set up outside of its system, where a
/// system's virtual clock does not run yet: [`on_virtual_time`](Self::on_virtual_time) has a
/// network on which time advances by 10 µs a frame there, so that a test has one outcome.
#[derive(Debug, Clone)]
pub struct Network {
    line: Arc<Mutex<Line>>,
    number: u32,
}

impl Default for Network {
    fn default() -> Self {
        Self::new()
    }
}

impl Network {
    /// A network without subdevices.
    pub fn new() -> Self {
        Self::with_time(false)
    }

    /// As [`new`](Self::new), for a system on a [virtual clock](luna::System::virtual_clock).
    pub fn on_virtual_time() -> Self {
        Self::with_time(true)
    }

    fn with_time(is_virtual: bool) -> Self {
        static NETWORKS: AtomicU32 = AtomicU32::new(0);
        let line = Line {
            subdevices: Vec::new(),
            time: Time {
                now: 1_000_000_000,
                is_virtual,
                last: None,
            },
            latency: 0,
            faults: Faults::default(),
            answers: VecDeque::with_capacity(WAITING),
            frames: 0,
        };
        Self {
            line: Arc::new(Mutex::new(line)),
            number: NETWORKS.fetch_add(1, Ordering::Relaxed),
        }
    }

    /// Appends a subdevice to the line. Returns its position, from 0.
    pub fn add(&self, subdevice: SubDevice) -> usize {
        let mut line = self.lock();
        let position = line.subdevices.len();
        let esc = Esc::new(subdevice, position as u64, line.time.now);
        line.subdevices.push(esc);
        line.link();
        position
    }

    /// How long after a request its answer comes; 0 if not stated.
    pub fn set_latency(&self, latency: Duration) {
        self.lock().latency = u64::try_from(latency.as_nanos()).unwrap_or(u64::MAX);
    }

    /// Loses the next `count` frames.
    pub fn lose(&self, count: u32) {
        self.lock().faults.lost = count;
    }

    /// Loses one in `count` frames; none if `None`.
    pub fn lose_one_in(&self, count: Option<u32>) {
        self.lock().faults.one_in = count;
    }

    /// Makes the working counter of the next `count` exchanges of process data wrong.
    pub fn miscount(&self, count: u32) {
        self.lock().faults.miscounted = count;
    }

    /// Cuts the cable before the subdevice at `position`: neither it nor those after it get frames.
    pub fn cut(&self, position: usize) {
        let mut line = self.lock();
        line.faults.cut = Some(position);
        line.link();
    }

    /// Mends the cable.
    pub fn mend(&self) {
        let mut line = self.lock();
        line.faults.cut = None;
        line.link();
    }

    /// Lets a subdevice leave the operational state by itself, with `code` as its reason. Nothing
    /// if there is none at `position`.
    pub fn fall(&self, position: usize, code: u16) {
        if let Some(esc) = self.lock().subdevices.get_mut(position) {
            esc.fall(code);
        }
    }

    /// Lets the mailbox of a subdevice take requests and never answer. Nothing if it has none.
    pub fn hang_mailbox(&self, position: usize) {
        self.look(position, |esc, _| {
            esc.coe.iter_mut().for_each(|coe| coe.hangs = true);
        });
    }

    /// Lets a subdevice report an emergency with `code` over its mailbox, before its next answer.
    /// Nothing if it has none.
    pub fn report_emergency(&self, position: usize, code: u16) {
        self.look(position, |esc, _| {
            esc.coe
                .iter_mut()
                .for_each(|coe| coe.emergency = Some(code));
        });
    }

    /// The value of an object of its [`Dictionary`](super::Dictionary), if it has that.
    pub fn object(&self, position: usize, index: u16, sub: u8) -> Option<SdoValue> {
        let value = |esc: &mut Esc, _| esc.coe.as_ref()?.value(index, sub).ok();
        self.look(position, value).flatten()
    }

    /// The frames that have come.
    pub fn frames(&self) -> u64 {
        self.lock().frames
    }

    /// Its state. [`State::Silent`] if there is no subdevice at `position`.
    pub fn state(&self, position: usize) -> State {
        self.look(position, |esc, _| esc.state())
            .unwrap_or(State::Silent)
    }

    /// The reason for its last change of state.
    pub fn code(&self, position: usize) -> u16 {
        self.look(position, |esc, _| esc.code()).unwrap_or(0)
    }

    /// What its machine gets: zeros unless it is operational.
    pub fn outputs(&self, position: usize) -> Vec<u8> {
        self.look(position, |esc, _| esc.applied().to_vec())
            .unwrap_or_default()
    }

    /// The outputs that were last written to it, in whatever state.
    pub fn written(&self, position: usize) -> Vec<u8> {
        self.look(position, |esc, _| esc.written().to_vec())
            .unwrap_or_default()
    }

    /// Its inputs.
    pub fn inputs(&self, position: usize) -> Vec<u8> {
        self.look(position, |esc, _| esc.inputs().to_vec())
            .unwrap_or_default()
    }

    /// Sets its inputs. They stay only if its [`Application`](super::Application) leaves them.
    pub fn set_inputs(&self, position: usize, inputs: &[u8]) {
        self.look(position, |esc, _| {
            for (to, from) in esc.inputs().iter_mut().zip(inputs) {
                *to = *from;
            }
        });
    }

    /// The distributed time of its clock (ns), if it has one.
    pub fn system_time(&self, position: usize) -> Option<u64> {
        self.look(position, |esc, now| esc.system_time(now))
            .flatten()
    }

    /// How long after its last SYNC0 the last process data came to it (ns), if SYNC0 is active.
    pub fn sync_phase(&self, position: usize) -> Option<u64> {
        self.look(position, |esc, _| {
            esc.clock.as_ref().and_then(|it| it.phase)
        })
        .flatten()
    }

    fn look<T>(&self, position: usize, look: impl FnOnce(&mut Esc, u64) -> T) -> Option<T> {
        let mut line = self.lock();
        let now = match line.time.is_virtual && !Clock::is_virtual_here() {
            // A look takes no time.
            true => line.time.now,
            false => line.time.advance(),
        };
        let esc = line.subdevices.get_mut(position)?;
        esc.advance(now);
        Some(look(esc, now))
    }

    /// A number of its own.
    pub(crate) fn number(&self) -> u32 {
        self.number
    }

    /// Its own time (ns).
    pub(crate) fn time(&self) -> u64 {
        self.lock().time.now
    }

    /// Whether it is for a virtual clock.
    pub(crate) fn is_virtual(&self) -> bool {
        self.lock().time.is_virtual
    }

    /// Forgets the answers to another bus.
    pub(crate) fn clear(&self) {
        self.lock().answers.clear();
    }

    /// Sends a frame along the line.
    pub(crate) fn send(&self, bytes: &[u8]) {
        let mut line = self.lock();
        let line = &mut *line;
        line.frames += 1;
        let now = line.time.advance();
        if line.answers.len() == WAITING || bytes.len() > MAX_FRAME || line.faults.loses() {
            return;
        }
        let mut answer = Answer {
            at: now.saturating_add(line.latency),
            length: bytes.len(),
            bytes: [0; MAX_FRAME],
        };
        answer.bytes[..bytes.len()].copy_from_slice(bytes);
        if line.process(
            &mut answer.bytes[..bytes.len()],
            now.saturating_add(line.latency / 2),
        ) {
            line.answers.push_back(answer);
        }
    }

    /// Takes the next answer, if one has come.
    pub(crate) fn receive(&self, to: &mut [u8]) -> Option<usize> {
        let mut line = self.lock();
        let now = line.time.advance();
        line.answers.front().filter(|answer| answer.at <= now)?;
        let answer = line.answers.pop_front()?;
        let length = answer.length.min(to.len());
        to[..length].copy_from_slice(&answer.bytes[..length]);
        Some(length)
    }

    /// How long until the next answer comes, if one does.
    pub(crate) fn next_answer(&self) -> Option<Duration> {
        let line = self.lock();
        let next = line.answers.front()?;
        Some(Duration::from_nanos(next.at.saturating_sub(line.time.now)))
    }

    /// Answers `frame` in place, as on the wire. Returns whether it comes back.
    pub(crate) fn answer(&self, frame: &mut [u8]) -> bool {
        let mut line = self.lock();
        line.frames += 1;
        let now = line.time.advance();
        !line.faults.loses() && line.process(frame, now)
    }

    fn lock(&self) -> MutexGuard<'_, Line> {
        // A test that failed may look at it.
        self.line.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
