//! The line of a simulated network: how frames pass its subdevices, and what faults do to them.

use super::esc::Esc;
use crate::frame::{self, Datagram, MAX_FRAME, command};
use luna::Instant;
use luna_platform::clock::Clock;
use std::collections::VecDeque;

/// From one subdevice to the next (ns).
const HOP: u64 = 500;
/// How long a frame takes on a virtual clock while the bus is set up: no time passes there.
const STEP: u64 = 10_000;
/// The limit of answers that nobody has taken.
pub(super) const WAITING: usize = 64;

#[derive(Debug)]
pub(super) struct Line {
    pub(super) subdevices: Vec<Esc>,
    pub(super) time: Time,
    pub(super) latency: u64,
    pub(super) faults: Faults,
    pub(super) answers: VecDeque<Answer>,
    pub(super) frames: u64,
}

#[derive(Debug, Default)]
pub(super) struct Faults {
    /// How many of the next frames are lost.
    pub(super) lost: u32,
    /// One in so many is lost.
    pub(super) one_in: Option<u32>,
    pub(super) since: u32,
    /// How many of the next exchanges of process data have a wrong working counter.
    pub(super) miscounted: u32,
    /// Before which subdevice the cable is cut.
    pub(super) cut: Option<usize>,
}

#[derive(Debug)]
pub(super) struct Answer {
    pub(super) at: u64,
    pub(super) length: usize,
    pub(super) bytes: [u8; MAX_FRAME],
}

/// The network's time (ns).
#[derive(Debug)]
pub(super) struct Time {
    pub(super) now: u64,
    pub(super) is_virtual: bool,
    pub(super) last: Option<(usize, Instant)>,
}

impl Time {
    pub(super) fn advance(&mut self) -> u64 {
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

impl Faults {
    pub(super) fn loses(&mut self) -> bool {
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

    pub(super) fn link(&mut self) {
        let reached = self.reached();
        for (position, esc) in self.subdevices.iter_mut().enumerate() {
            esc.link(position + 1 < reached);
        }
    }

    pub(super) fn process(&mut self, bytes: &mut [u8], now: u64) -> bool {
        let reached = self.reached();
        for (position, esc) in self.subdevices.iter_mut().enumerate() {
            esc.advance(now.saturating_add(HOP * position as u64));
        }
        if reached == 0 || !frame::is_request(bytes) {
            return false;
        }
        frame::mark_answered(bytes);
        for mut datagram in frame::datagrams(bytes) {
            for position in 0..reached {
                let esc = &mut self.subdevices[position];
                let hops = [position, reached - 1 - position].map(|it| HOP * it as u64);
                serve(esc, &mut datagram, now.saturating_add(hops[0]), 2 * hops[1]);
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
