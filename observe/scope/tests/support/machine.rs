//! A simulated recording of a machine with two axes: 32 curves at 1 kHz, processes with their
//! states, a late cycle now and then.
//!
//! It is computed, and the same each time, for tests that need to know the time of each event.

use luna_logger::format::{ClockBase, Event, Level, Record, SignalInfo, Subject, Type, Values};

pub const PERIOD: u64 = 1_000_000;
const FIRST: u64 = 86_400_000_000_000;
/// The first cycle after which a more urgent process takes too long; it does so repeatedly.
const LATE_FIRST: u64 = 700;
const LATE_EVERY: u64 = 3000;

const CONTROL: u32 = 1;
const MECHANISM: u32 = 2;
const OPERATOR: u32 = 3;

/// Number, parent, name. The executor is where a process is seen to run.
const PROCESSES: [(u32, u32, &str); 20] = [
    (1, 0, "pan"),
    (2, 1, "pan/read"),
    (3, 1, "pan/scale"),
    (4, 1, "pan/controller"),
    (5, 1, "pan/safety"),
    (6, 1, "pan/write"),
    (7, 0, "tilt"),
    (8, 7, "tilt/read"),
    (9, 7, "tilt/scale"),
    (10, 7, "tilt/controller"),
    (11, 7, "tilt/safety"),
    (12, 7, "tilt/write"),
    (13, 0, "calibration"),
    (14, 0, "motors"),
    (15, 14, "motors/pan"),
    (16, 14, "motors/tilt"),
    (17, 0, "encoders"),
    (18, 0, "joystick"),
    (19, 0, "camera"),
    (20, 0, "display"),
];

const CHANNELS: [&str; 12] = [
    "pan/raw",
    "pan/angle",
    "pan/wanted",
    "pan/volts",
    "tilt/raw",
    "tilt/angle",
    "tilt/wanted",
    "tilt/volts",
    "motors/pan",
    "motors/tilt",
    "joystick/setpoint",
    "camera/frames",
];

const LOOPS: [(u32, u32, &str); 4] = [
    (1, 2, "pan"),
    (2, 8, "tilt"),
    (3, 17, "mechanism"),
    (4, 18, "joystick"),
];

const CODES: [&str; 13] = [
    "ready",
    "running",
    "waiting",
    "done",
    "communication",
    "alternative",
    "executor asleep",
    "executor awake",
    "priority",
    "slot",
    "late cycle",
    "emergency",
    "spawned",
];

/// Name and unit of each signal; the last one has three elements.
const SIGNALS: [(&str, &str); 30] = [
    ("pan/setpoint", "deg"),
    ("pan/angle", "deg"),
    ("pan/speed", "deg/s"),
    ("pan/error", "deg"),
    ("pan/voltage", "V"),
    ("pan/current", "A"),
    ("tilt/setpoint", "deg"),
    ("tilt/angle", "deg"),
    ("tilt/speed", "deg/s"),
    ("tilt/error", "deg"),
    ("tilt/voltage", "V"),
    ("tilt/current", "A"),
    ("supply/voltage", "V"),
    ("supply/current", "A"),
    ("motor/pan/temperature", "°C"),
    ("motor/tilt/temperature", "°C"),
    ("pan/observer/load", "Nm"),
    ("tilt/observer/load", "Nm"),
    ("pan/integral", "V"),
    ("tilt/integral", "V"),
    ("pan/feed-forward", "V"),
    ("tilt/feed-forward", "V"),
    ("joystick/x", ""),
    ("joystick/y", ""),
    ("camera/exposure", "ms"),
    ("camera/blur", "px"),
    ("pan/at-end", ""),
    ("tilt/at-end", ""),
    ("vibration", "m/s²"),
    ("imu/acceleration", "m/s²"),
];

pub struct Machine {
    cycle: u64,
    random: u64,
    axes: [Axis; 2],
    emergency_at: Option<u64>,
    is_declared: bool,
    /// What happens after the next slot: it comes in the order of time.
    pending: Vec<Event>,
}

#[derive(Default, Clone, Copy)]
struct Axis {
    angle: f64,
    speed: f64,
    integral: f64,
}

type Put<'a> = dyn FnMut(&Record<'_>) + 'a;

impl Machine {
    pub fn new() -> Machine {
        Machine {
            cycle: 0,
            random: 0x9E37_79B9_7F4A_7C15,
            axes: [Axis::default(); 2],
            emergency_at: None,
            is_declared: false,
            pending: Vec::new(),
        }
    }

    /// In this cycle the operator raises an emergency.
    pub fn emergency_at(mut self, cycle: u64) -> Machine {
        self.emergency_at = Some(cycle);
        self
    }

    /// Computes all events up to this many nanoseconds after the start.
    pub fn until(&mut self, nanos: u64, put: &mut Put<'_>) {
        if !self.is_declared {
            self.is_declared = true;
            declare(put);
        }
        while self.cycle * PERIOD < nanos {
            let mut happened = std::mem::take(&mut self.pending);
            self.one_cycle(&mut |record| match record {
                Record::Event(event) => happened.push(*event),
                other => put(other),
            });
            self.cycle += 1;
            happened.sort_by_key(|event| event.time);
            // Nothing of the next cycle is earlier.
            let next = FIRST + self.cycle * PERIOD - 200_000;
            let now = happened.partition_point(|event| event.time < next);
            self.pending = happened.split_off(now);
            happened
                .iter()
                .for_each(|event| put(&Record::Event(*event)));
        }
    }

    pub fn cycles(&self) -> u64 {
        self.cycle
    }

    fn noise(&mut self) -> f64 {
        self.random ^= self.random << 13;
        self.random ^= self.random >> 7;
        self.random ^= self.random << 17;
        (self.random >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Nanoseconds around `middle`, seldom far above it.
    fn about(&mut self, middle: u64) -> u64 {
        let one = self.noise();
        let tail = if one > 0.995 { 3.0 } else { 0.0 };
        (middle as f64 * (0.75 + 0.5 * self.noise() + tail * self.noise())) as u64
    }

    fn one_cycle(&mut self, put: &mut Put<'_>) {
        let slot = FIRST + self.cycle * PERIOD;
        let is_late =
            self.cycle >= LATE_FIRST && (self.cycle - LATE_FIRST).is_multiple_of(LATE_EVERY);
        let mut trace = Trace {
            thread: CONTROL,
            time: slot,
            put,
        };
        if self.cycle == 0 {
            message(
                trace.put,
                slot,
                Level::Info,
                13,
                "both axes have found their end stops",
            );
        }
        // When the process that held the loops up was done.
        let mut late_from = slot;
        if is_late {
            // It was running when the slot came.
            trace.time = slot - 120_000;
            trace.event(8, CONTROL, 0, 0);
            trace.turn(13, 760_000 + (self.cycle % 7) * 31_000, (3, 3));
            late_from = trace.time;
            trace.time += 4_000;
        } else {
            trace.time += self.about(9_000);
            trace.event(8, CONTROL, 0, 0);
            trace.time += 1_500;
        }
        for axis in 0..2u32 {
            let lateness = trace.time - slot;
            trace.event(10, axis + 1, self.cycle, lateness);
            if is_late {
                // Which the other process explains in part; the cycle began on core 1.
                let explained = (late_from - slot) * 100 / lateness;
                trace.event(11, axis + 1, lateness, 2 | explained << 8 | 2 << 16);
            }
            self.chain(&mut trace, axis);
        }
        trace.event(7, CONTROL, 0, 0);
        if is_late {
            let text = "a cycle began late: `calibration` ran instead";
            message(trace.put, trace.time, Level::Warn, 4, text);
        }
        let end = trace.time.max(slot + 400_000);
        self.mechanism(end, slot, put);
        self.operator(end + 150_000, put);
        self.signals(slot + PERIOD - 50_000, put);
        if self.emergency_at == Some(self.cycle) {
            let text = "the emergency stop was pressed";
            message(put, slot + PERIOD - 40_000, Level::Error, 18, text);
            event(put, OPERATOR, slot + PERIOD - 40_000, 12, 18, [3, 0]);
        }
        if self.cycle.is_multiple_of(10_000) {
            put(&Record::Epoch {
                time: slot,
                unix: 1_790_000_000_000_000_000 + (self.cycle * PERIOD) as i64,
            });
        }
    }

    /// Read, scale, control, check, write: each passes its result on and waits for the next value.
    fn chain(&mut self, trace: &mut Trace<'_>, axis: u32) {
        let first = if axis == 0 { 2 } else { 8 };
        let work = [11_000, 8_000, 34_000, 9_000, 12_000];
        trace.event(1, first, 0, 0);
        for (at, nanos) in work.into_iter().enumerate() {
            let (at, process) = (at as u32, first + at as u32);
            let channel = axis * 4 + at + 1;
            trace.event(2, process, 0, 0);
            trace.time += self.about(nanos);
            if at < 4 {
                trace.event(5, channel, process.into(), (process + 1).into());
                trace.event(1, process + 1, process.into(), 0);
                trace.time += 900;
            }
            match at {
                0 => trace.event(3, process, 6, (axis + 1).into()),
                _ => trace.event(3, process, 3, (channel - 1).into()),
            }
            trace.time += 1_100;
        }
    }

    fn mechanism(&mut self, at: u64, slot: u64, put: &mut Put<'_>) {
        let mut trace = Trace {
            thread: MECHANISM,
            time: at,
            put,
        };
        trace.event(8, MECHANISM, 0, 0);
        let late = self.about(7_000);
        trace.event(10, 3, self.cycle, late.min(trace.time - slot));
        trace.event(5, 9, 6, 15);
        trace.turn(15, self.about(41_000), (3, 9));
        trace.event(5, 10, 12, 16);
        trace.turn(16, self.about(41_000), (3, 10));
        trace.turn(17, self.about(15_000), (6, 3));
        trace.event(7, MECHANISM, 0, 0);
    }

    fn operator(&mut self, at: u64, put: &mut Put<'_>) {
        if !self.cycle.is_multiple_of(20) {
            return;
        }
        let mut trace = Trace {
            thread: OPERATOR,
            time: at,
            put,
        };
        trace.event(8, OPERATOR, 0, 0);
        let late = self.about(60_000);
        trace.event(10, 4, self.cycle / 20, late);
        trace.turn(18, self.about(30_000), (6, 4));
        trace.event(5, 11, 18, 4);
        trace.turn(19, self.about(90_000), (0, 0));
        trace.event(5, 12, 19, 20);
        trace.turn(20, self.about(60_000), (3, 12));
        trace.event(7, OPERATOR, 0, 0);
    }

    fn signals(&mut self, time: u64, put: &mut Put<'_>) {
        let t = self.cycle as f64 * 1e-3;
        let dt = 1e-3;
        let mut values = Vec::with_capacity(32);
        // A step each few seconds, with a slow swing on it.
        let step = |rate: f64| if (t * rate).fract() < 0.5 { 1.0 } else { -1.0 };
        let setpoints = [
            18.0 * step(0.31) + 6.0 * (t * 1.3).sin(),
            9.0 * step(0.23) + 4.0 * (t * 0.9).cos(),
        ];
        for (axis, setpoint) in setpoints.into_iter().enumerate() {
            let noise = self.noise() - 0.5;
            let Axis {
                angle,
                speed,
                integral,
            } = &mut self.axes[axis];
            let error = setpoint - *angle;
            *integral = (*integral + error * dt * 0.4).clamp(-3.0, 3.0);
            let voltage = (0.9 * error - 0.07 * *speed + *integral).clamp(-24.0, 24.0);
            *speed += (voltage * 95.0 - *speed * 7.5 + noise * 260.0) * dt;
            *angle += *speed * dt;
            let current = (voltage - *speed * 0.028) * 0.16;
            values.extend([setpoint, *angle, *speed, error, voltage, current]);
        }
        let (pan, tilt) = (self.axes[0], self.axes[1]);
        let noise: [f64; 8] = std::array::from_fn(|_| self.noise() - 0.5);
        let load = values[5].abs() + values[11].abs();
        values.extend([
            24.1 - 0.12 * load + 0.02 * noise[0],
            0.6 + load + 0.05 * noise[1],
            41.0 + 2.0 * (t * 0.05).sin() + 0.02 * noise[2],
            38.0 + 1.5 * (t * 0.04).cos() + 0.02 * noise[3],
            0.2 * pan.speed.signum() * (pan.speed.abs() / 40.0).min(1.0),
            0.1 * tilt.speed.signum() * (tilt.speed.abs() / 40.0).min(1.0),
            pan.integral,
            tilt.integral,
            0.05 * setpoints[0],
            0.05 * setpoints[1],
            (t * 1.3).sin(),
            (t * 0.9).cos(),
            8.0 + (t * 0.4).sin(),
            (pan.speed.abs() + tilt.speed.abs()) * 0.02,
            f64::from(u8::from(pan.angle.abs() > 22.0)),
            f64::from(u8::from(tilt.angle.abs() > 11.0)),
            (t * 2.0 * std::f64::consts::PI * 47.0).sin() * (0.3 + load * 0.2) + noise[4] * 0.2,
            (t * 13.0).sin() * 0.4 + noise[5] * 0.2,
            (t * 11.0).cos() * 0.4 + noise[6] * 0.2,
            9.81 + noise[7] * 0.3,
        ]);
        for (number, _) in SIGNALS.iter().enumerate() {
            let elements = if number == SIGNALS.len() - 1 { 3 } else { 1 };
            let bytes: Vec<u8> = values[number..number + elements]
                .iter()
                .flat_map(|value| value.to_le_bytes())
                .collect();
            put(&Record::Sample {
                signal: number as u32,
                time,
                values: Values::from_bytes(Type::F64, &bytes),
            });
        }
    }
}

/// The events of one thread.
struct Trace<'a> {
    thread: u32,
    time: u64,
    put: &'a mut Put<'a>,
}

impl Trace<'_> {
    fn event(&mut self, code: u16, subject: u32, a: u64, b: u64) {
        event(self.put, self.thread, self.time, code, subject, [a, b]);
    }

    /// A process becomes ready, runs and waits again.
    fn turn(&mut self, process: u32, nanos: u64, waits_for: (u64, u64)) {
        self.event(1, process, 0, 0);
        self.time += 800;
        self.event(2, process, 0, 0);
        self.time += nanos;
        self.event(3, process, waits_for.0, waits_for.1);
        self.time += 700;
    }
}

fn event(put: &mut Put<'_>, thread: u32, time: u64, code: u16, subject: u32, arguments: [u64; 2]) {
    put(&Record::Event(Event {
        thread,
        time,
        code,
        subject,
        arguments,
    }));
}

fn message(put: &mut Put<'_>, time: u64, level: Level, process: u32, text: &str) {
    put(&Record::Message {
        thread: CONTROL,
        time,
        level,
        process,
        truncated: false,
        target: "machine",
        text,
    });
}

fn declare(put: &mut Put<'_>) {
    put(&Record::Session {
        system: "two axes",
        clock: ClockBase::Monotonic,
        written_by: "luna-scope's tests",
    });
    for (number, name) in [
        (CONTROL, "control"),
        (MECHANISM, "mechanism"),
        (OPERATOR, "operator"),
    ] {
        put(&Record::Thread { number, name });
        name_of(put, Subject::Executor, number, 0, name);
    }
    for (number, parent, name) in PROCESSES {
        name_of(put, Subject::Process, number, parent, name);
    }
    for (at, name) in CHANNELS.iter().enumerate() {
        name_of(put, Subject::Channel, at as u32 + 1, 0, name);
    }
    for (number, process, name) in LOOPS {
        name_of(put, Subject::Loop, number, process, name);
    }
    for (at, name) in CODES.iter().enumerate() {
        name_of(put, Subject::Code, at as u32 + 1, 0, name);
    }
    for (number, (name, unit)) in SIGNALS.into_iter().enumerate() {
        put(&Record::Signal(SignalInfo {
            number: number as u32,
            element_type: Type::F64,
            elements: if number == SIGNALS.len() - 1 { 3 } else { 1 },
            name,
            unit,
            description: "",
        }));
    }
    for (process, executor) in [(1, CONTROL), (7, CONTROL), (14, MECHANISM)] {
        // Constructs wait for their parts.
        event(put, executor, FIRST, 2, process, [0; 2]);
        event(put, executor, FIRST, 3, process, [0; 2]);
    }
}

fn name_of(put: &mut Put<'_>, subject: Subject, number: u32, parent: u32, name: &str) {
    put(&Record::Name {
        subject,
        number,
        parent,
        name,
        runs_on: None,
    });
}
