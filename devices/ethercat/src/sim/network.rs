//! The simulated wire with its subdevices.

use super::esc::Esc;
use super::subdevice::SubDevice;
use crate::State;
use crate::frame::{self, Datagram, MAX_FRAME, command};
use luna::Instant;
use luna_platform::clock::Clock;
use std::collections::VecDeque;
use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// From one subdevice to the next (ns).
const HOP: u64 = 500;
/// How long a frame takes on a virtual clock while the bus is set up: no time passes there.
const STEP: u64 = 10_000;
/// The limit of answers that nobody has taken.
const WAITING: usize = 64;

/// A simulated EtherCAT network: a line of subdevices.
///
/// Clones are the same network, for a test that looks at it and injects faults while a bus uses it.
/// It is processed by the threads that call it, under a lock; so it is not for the real-time path.
///
/// It goes by the clock of the calling thread. A bus is set up outside of its system, where a
/// system's virtual clock does not run yet: [`on_virtual_time`](Self::on_virtual_time) has a
/// network whose time advances by 10 µs a frame there, so that a test has one outcome.
#[derive(Debug, Clone)]
pub struct Network {
    line: Arc<Mutex<Line>>,
    number: u32,
}

#[derive(Debug)]
struct Line {
    subdevices: Vec<Esc>,
    time: Time,
    latency: u64,
    faults: Faults,
    answers: VecDeque<Answer>,
    frames: u64,
}

#[derive(Debug, Default)]
struct Faults {
    /// How many of the next frames are lost.
    lost: u32,
    /// One in so many is lost.
    one_in: Option<u32>,
    since: u32,
    /// How many of the next exchanges of process data have a wrong working counter.
    miscounted: u32,
    /// Before which subdevice the cable is cut.
    cut: Option<usize>,
}

#[derive(Debug)]
struct Answer {
    at: u64,
    length: usize,
    bytes: [u8; MAX_FRAME],
}

/// The network's time (ns).
#[derive(Debug)]
struct Time {
    now: u64,
    is_virtual: bool,
    last: Option<(usize, Instant)>,
}

impl Time {
    fn advance(&mut self) -> u64 {
        let here = (Clock::number_here(), luna::now());
        let passed = match self.last {
            Some((clock, last)) if clock == here.0 => here.1.nanos_since(last),
            _ => 0,
        };
        self.now += match self.is_virtual && !Clock::is_virtual_here() {
            true => STEP,
            false => passed,
        };
        self.last = Some(here);
        self.now
    }
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
            at: now + line.latency,
            length: bytes.len(),
            bytes: [0; MAX_FRAME],
        };
        answer.bytes[..bytes.len()].copy_from_slice(bytes);
        if line.process(&mut answer.bytes[..bytes.len()], now + line.latency / 2) {
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

impl Faults {
    fn loses(&mut self) -> bool {
        if let Some(count) = self.one_in {
            self.since += 1;
            if self.since >= count {
                self.since = 0;
                return true;
            }
        }
        let is_lost = self.lost > 0;
        self.lost = self.lost.saturating_sub(1);
        is_lost
    }
}

impl Line {
    /// How many subdevices frames come to.
    fn reached(&self) -> usize {
        let all = self.subdevices.len();
        self.faults.cut.map_or(all, |cut| cut.min(all))
    }

    fn link(&mut self) {
        let reached = self.reached();
        for (position, esc) in self.subdevices.iter_mut().enumerate() {
            esc.link(position + 1 < reached);
        }
    }

    fn process(&mut self, bytes: &mut [u8], now: u64) -> bool {
        let reached = self.reached();
        for (position, esc) in self.subdevices.iter_mut().enumerate() {
            esc.advance(now + HOP * position as u64);
        }
        if reached == 0 || !frame::is_request(bytes) {
            return false;
        }
        frame::mark_answered(bytes);
        for mut datagram in frame::datagrams(bytes) {
            for position in 0..reached {
                let esc = &mut self.subdevices[position];
                let hops = [position, reached - 1 - position].map(|it| HOP * it as u64);
                serve(esc, &mut datagram, now + hops[0], 2 * hops[1]);
            }
            let is_process_data = datagram.command == command::LRW;
            if is_process_data && self.faults.miscounted > 0 {
                self.faults.miscounted -= 1;
                datagram.miscount();
            }
        }
        true
    }
}

/// What a datagram does at one subdevice.
fn serve(esc: &mut Esc, datagram: &mut Datagram<'_>, now: u64, back: u64) {
    let register = datagram.register;
    let is_here = match datagram.command {
        command::APRD | command::APWR => datagram.address() == 0,
        command::FPRD | command::FPWR => datagram.address() == esc.station(),
        _ => true,
    };
    let counted = match datagram.command {
        _ if !is_here => 0,
        command::APRD | command::FPRD => {
            datagram.data.fill(0);
            u16::from(esc.read(register, datagram.data, now))
        }
        command::BRD => u16::from(esc.read(register, datagram.data, now)),
        command::APWR | command::FPWR | command::BWR => {
            u16::from(esc.write(register, datagram.data, now, back))
        }
        command::FRMW if datagram.address() == esc.station() => {
            datagram.data.fill(0);
            u16::from(esc.read(register, datagram.data, now))
        }
        command::FRMW => u16::from(esc.write(register, datagram.data, now, back)),
        command::LRD | command::LWR | command::LRW => {
            let may = [command::LRD, command::LWR].map(|other| datagram.command != other);
            let [may_write, may_read] = may;
            let logical = datagram.logical();
            let done = esc.exchange(logical, datagram.data, [may_read, may_write], now);
            let write = if datagram.command == command::LRW {
                2
            } else {
                1
            };
            u16::from(done[0]) + write * u16::from(done[1])
        }
        _ => 0,
    };
    datagram.count(counted);
    if matches!(
        datagram.command,
        command::APRD | command::APWR | command::BRD | command::BWR
    ) {
        datagram.pass();
    }
}
