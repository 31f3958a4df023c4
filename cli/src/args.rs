//! The command line.

use clap::{Args, Parser, Subcommand, ValueEnum};
use glob::Pattern;
use luna::Policy;
use std::net::SocketAddr;
use std::ops::RangeInclusive;
use std::path::PathBuf;
use std::time::Duration;

/// The rates that Jiwy's controllers and mechanism are made and tested for, in Hz.
const RATES: RangeInclusive<u32> = 100..=4000;
/// A run of the demo takes at most a day.
const MAX_SECONDS: f64 = 86_400.0;
/// A period is at most a minute, in µs.
const MAX_INTERVAL: u64 = 60_000_000;

/// Where the scope listens: this machine alone can reach it.
pub(crate) const SCOPE: &str = "127.0.0.1:8620";

/// Where Foxglove looks first: this machine alone can reach it.
#[cfg(feature = "foxglove")]
const FOXGLOVE: &str = "127.0.0.1:8765";

/// LUNA: hard real-time processes and channels. Without a command: the demo.
#[derive(Debug, Parser)]
#[command(name = "luna", version, args_conflicts_with_subcommands = true)]
pub(crate) struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    demo: Demo,
}

impl Arguments {
    /// What is to be done.
    pub(crate) fn command(self) -> Command {
        self.command.unwrap_or_else(|| {
            Command::Demo(Box::new(Demos {
                #[cfg(target_os = "linux")]
                machine: None,
                jiwy: self.demo,
            }))
        })
    }
}

/// What the program can do.
#[derive(Debug, Subcommand)]
pub(crate) enum Command {
    /// Controls a simulated pan-tilt camera and shows how well it kept time; or another machine
    Demo(Box<Demos>),
    /// Measures how late a periodic process wakes up, as cyclictest does
    Jitter(Jitter),
    /// Says whether this machine is fit for hard real time, and what to do about what is not
    Doctor(Doctor),
    /// Makes CSV, an MCAP file or a Perfetto trace of a recording
    Convert(Convert),
    /// Receives what other programs record (LUNA_LOG=tcp://HOST:PORT), also of other computers, and
    /// writes a file for each
    Record(Record),
    /// Shows a recording in the browser, as it was while it was made
    Scope(Scope),
    /// Makes a project that runs at once, with tests, a system file and CI
    New(crate::new::Arguments),
    /// Makes, checks and draws models of systems
    #[command(subcommand)]
    Model(crate::model::Command),
    /// Lists the systems, programs and channels between programs that are alive on this computer,
    /// with their rates
    #[cfg(target_os = "linux")]
    List(crate::programs::list::Arguments),
    /// Prints the values of a channel between programs, as its receiver, or of a blackboard
    #[cfg(target_os = "linux")]
    Echo(crate::programs::echo::Arguments),
    /// Sends values to a channel between programs, as its sender, or sets keys of a blackboard
    #[cfg(target_os = "linux")]
    Send(crate::programs::send::Arguments),
}

/// Processes beside the measured one: as many as a system reserves room for, with some to spare.
const MAX_OTHERS: i64 = 250;

/// What `luna demo` runs: the camera, unless another machine is named.
#[derive(Debug, Clone, Args)]
#[command(args_conflicts_with_subcommands = true)]
pub(crate) struct Demos {
    #[cfg(target_os = "linux")]
    #[command(subcommand)]
    pub(crate) machine: Option<Machine>,
    #[command(flatten)]
    pub(crate) jiwy: Demo,
}

/// The other machines.
#[cfg(target_os = "linux")]
#[derive(Debug, Clone, Subcommand)]
pub(crate) enum Machine {
    /// Six units in a circle, on one executor, on six threads, as six programs or on six hosts
    ProductionCell(crate::production_cell::Arguments),
    /// One unit of the Production Cell as a program of its own, started by `--deploy programs`
    #[command(hide = true)]
    ProductionCellUnit(crate::production_cell::UnitArguments),
    /// A neck and two eyes that follow a target, with vision that is not real-time
    Head(crate::head::Arguments),
    /// The vision of the head, for another computer: `luna demo head --vision ADDR`
    HeadVision(crate::head::VisionArguments),
    /// A robot with fourteen joints that walks behind a ball
    Tulip(crate::tulip::Arguments),
    /// The operator of TUlip, for another computer: `luna demo tulip --operator ADDR`
    TulipOperator(crate::tulip::OperatorArguments),
}

/// The options of `luna demo`.
#[derive(Debug, Clone, Args)]
#[command(after_help = crate::exit::OF_DEMO)]
pub(crate) struct Demo {
    /// How long to run, in seconds
    #[arg(long, value_name = "S", default_value = "10", value_parser = seconds, allow_negative_numbers = true)]
    pub(crate) seconds: f64,
    /// Cycles of control in a second
    #[arg(long, value_name = "HZ", default_value_t = 1000, value_parser = rate, allow_negative_numbers = true)]
    pub(crate) rate: u32,
    #[command(flatten)]
    pub(crate) place: Placement,
    /// A CSV file with the columns time (s), pan and tilt (-1 to 1), or an input device
    /// (/dev/input/event0) [default: such a file within the program]
    #[arg(long, value_name = "FILE")]
    pub(crate) joystick: Option<PathBuf>,
    /// On a virtual clock: time jumps to the next cycle when all is computed, and every run is the
    /// same
    #[arg(long = "virtual")]
    pub(crate) on_virtual_clock: bool,
    /// Record signals, messages and events, for `luna convert` and `luna scope` (.luna)
    #[arg(long, value_name = "FILE", conflicts_with = "replay")]
    pub(crate) log: Option<PathBuf>,
    /// Write a replay log (.replay): what was not determined in the run, for --replay
    #[arg(long, value_name = "FILE")]
    pub(crate) record: Option<PathBuf>,
    /// Do the run of a replay log again, on a virtual clock, and say whether its outputs are the
    /// same, or at which event they differ
    #[arg(long, value_name = "FILE", conflicts_with_all = ["record", "seconds", "rate", "joystick", "calibrated", "core", "policy", "parameters", "set"])]
    pub(crate) replay: Option<PathBuf>,
    /// A TOML file with the controllers' parameters: kp, ki, kd and filter below [pan] and [tilt]
    #[arg(long, value_name = "FILE")]
    pub(crate) parameters: Option<PathBuf>,
    /// The value of a parameter, over that of the file: pan/kp=2.5. Several are set by several
    /// --set
    #[arg(long, value_name = "NAME=VALUE")]
    pub(crate) set: Vec<String>,
    /// End with exit code 5 if the control loop missed a slot
    #[arg(long, conflicts_with = "replay")]
    pub(crate) strict: bool,
    /// Print the run's row of table 4 of the LUNA paper, beside the paper's of the same rate
    #[arg(long, conflicts_with = "replay")]
    pub(crate) table_4: bool,
    /// Do not look for the end stops first: the encoders are known to count from the middle
    #[arg(long)]
    pub(crate) calibrated: bool,
    /// The card between the processes and the machine: mesa-sim, a simulated Mesa 7I92 in this
    /// program, or mesa:HOST[:PORT], a real one [default: none, the machine is simulated by
    /// processes]
    #[arg(long, value_name = "CARD", value_parser = crate::card::parse, conflicts_with = "on_virtual_clock")]
    pub(crate) card: Option<crate::card::Choice>,
    /// Serve the live scope while it runs, for a browser on this machine; ADDR is host:port
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = SCOPE, conflicts_with = "replay")]
    pub(crate) scope: Option<SocketAddr>,
    /// Print the scope's address with a token: with it a viewer may set the controllers' parameters
    #[arg(long, requires = "scope")]
    pub(crate) scope_token: bool,
    /// Serve signals, messages and events while it runs, for Foxglove and Lichtblick on this
    /// machine; ADDR is host:port
    #[cfg(feature = "foxglove")]
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = FOXGLOVE, conflicts_with = "replay")]
    pub(crate) foxglove: Option<SocketAddr>,
}

impl Demo {
    /// The time from one cycle to the next.
    pub(crate) fn period(&self) -> Duration {
        Duration::from_secs(1) / self.rate
    }

    /// How many cycles the run has: at least one.
    pub(crate) fn cycles(&self) -> u64 {
        // Within range by the parsers: at most a day at 4 kHz.
        ((self.seconds * f64::from(self.rate)).round() as u64).max(1)
    }
}

/// The options of `luna jitter`.
#[derive(Debug, Clone, Args)]
pub(crate) struct Jitter {
    /// From one wake-up to the next, in µs
    #[arg(long, value_name = "US", default_value_t = 1000, value_parser = interval, allow_negative_numbers = true)]
    pub(crate) interval: u64,
    /// How many wake-ups
    #[arg(long, value_name = "N", default_value_t = 10_000, value_parser = clap::value_parser!(u64).range(1..), allow_negative_numbers = true)]
    pub(crate) loops: u64,
    /// Spin for the last so many µs before each wake-up: at most a sixteenth of the interval
    #[arg(
        long,
        value_name = "US",
        default_value_t = 0,
        allow_negative_numbers = true
    )]
    pub(crate) guard: u64,
    /// How many other loops run on the same executor, at 100 Hz to 1 kHz and lower priorities
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = clap::value_parser!(u32).range(0..=MAX_OTHERS), allow_negative_numbers = true)]
    pub(crate) others: u32,
    /// Keep the core busy for so many ms at a time, from a thread of lower priority
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u64).range(1..=1000), allow_negative_numbers = true)]
    pub(crate) burn: Option<u64>,
    #[command(flatten)]
    pub(crate) place: Placement,
    /// Where to write the histogram, as CSV: latency_ns,count
    #[arg(long, value_name = "FILE")]
    pub(crate) histogram: Option<PathBuf>,
}

/// The options of `luna doctor`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Exit codes: 0 fit, or fit with findings (nothing is bad, but something could be better), 1 unfit (something is bad), 2 bad arguments,
3 broken (a self-test failed or hung), 4 unknown (nothing is bad, but too little could be read to say that it is fit).

JSON: schema, version, fitness (fit, fit_with_findings, unfit, broken, unknown), exit_code, core, this_machine,
counts (good, could_be_better, bad, unknown), self_tests (passed, failed, not_run), findings. A finding: name (stable), part (machine, measurement, self_test), verdict (good, could_be_better,
bad, unknown), read, from, why, advice (or null), and for a measurement ns (samples, min, p50, p99, max).")]
pub(crate) struct Doctor {
    /// The core that is to run real-time executors [default: the last isolated one, else the last]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(crate) core: Option<usize>,
    /// Measure a shorter time: half a second instead of two
    #[arg(long)]
    pub(crate) quick: bool,
    /// Do not measure
    #[arg(long)]
    pub(crate) no_measure: bool,
    /// Do not test the library's components
    #[arg(long)]
    pub(crate) no_self_test: bool,
    /// Say of good findings too why they matter
    #[arg(long)]
    pub(crate) explain: bool,
    /// Read another machine's files (proc, sys, ...) below DIR; nothing is measured or tested then
    #[arg(long, value_name = "DIR")]
    pub(crate) root: Option<PathBuf>,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub(crate) json: bool,
}

/// The options of `luna convert`.
#[derive(Debug, Clone, Args)]
pub(crate) struct Convert {
    /// The recording of the logger (.luna), as `System::log_to` or LUNA_LOG has made it. Several
    /// recordings become one Perfetto trace, with a process for each, and flows from a value's send
    /// in one program to its receive in another
    #[arg(value_name = "FILES", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// What to make of it
    #[arg(long, value_name = "FORMAT")]
    pub(crate) to: Format,
    /// How the times of several recordings are made those of one clock
    #[arg(long, value_name = "CLOCK", default_value = "monotonic")]
    pub(crate) clock: Clock,
    /// Seconds to be added to the times of the second recording, the third, and so on, beside what
    /// --clock does: 0.25,-3
    #[arg(
        long,
        value_name = "SECONDS",
        value_delimiter = ',',
        value_parser = offset,
        allow_hyphen_values = true
    )]
    pub(crate) offset: Vec<i64>,
    /// Where to write [default: beside the first recording]
    #[arg(long, short, value_name = "FILE")]
    pub(crate) output: Option<PathBuf>,
    /// CSV: a signal that was not sampled at a row's time holds its last value, instead of an empty
    /// cell
    #[arg(long)]
    pub(crate) hold: bool,
    /// CSV: a row for each cycle of this loop, with the last value of each signal in the cycle; for
    /// recordings with events
    #[arg(long, value_name = "LOOP")]
    pub(crate) per_cycle: Option<String>,
    #[command(flatten)]
    pub(crate) selection: Selection,
}

/// Where the times of several recordings come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Clock {
    /// Programs of one computer, since its start: their times are those of one clock already
    Monotonic,
    /// Programs of several computers, or of one that was started anew: by the times of the day
    Wall,
}

/// What of a recording is converted. Without an option of a kind, all of that kind is.
#[derive(Debug, Clone, Default, Args)]
pub(crate) struct Selection {
    /// Only signals of these names, as pan/*,tilt/angle; none for no signals
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) signals: Vec<Pattern>,
    /// Only events of these kinds, as late*,communication; none for no events
    #[arg(long, value_name = "KINDS", value_delimiter = ',')]
    pub(crate) events: Vec<Pattern>,
    /// Only events and messages of processes of these names
    #[arg(long, value_name = "NAMES", value_delimiter = ',')]
    pub(crate) process: Vec<Pattern>,
    /// Only what came so many seconds after the beginning of the recording, or later
    #[arg(long, value_name = "S", value_parser = instant)]
    pub(crate) from: Option<Duration>,
    /// Only what came before so many seconds after the beginning of the recording
    #[arg(long, value_name = "S", value_parser = instant)]
    pub(crate) until: Option<Duration>,
}

/// The options of `luna record`.
#[derive(Debug, Clone, Args)]
pub(crate) struct Record {
    /// Where to listen: HOST:PORT. Senders are not authenticated, so use 0.0.0.0 in trusted
    /// networks only
    #[arg(long, value_name = "ADDR", default_value = "127.0.0.1:7411")]
    pub(crate) listen: String,
    /// Take UDP datagrams (LUNA_LOG=udp://HOST:PORT) instead of TCP
    #[arg(long)]
    pub(crate) udp: bool,
    /// The folder for the files, which are named by system and start; with --once, the file
    /// [default: this folder]
    #[arg(long, short, value_name = "PATH")]
    pub(crate) output: Option<PathBuf>,
    /// Show messages of LEVEL and what matters more: error, warn, info, debug, trace, or none
    #[arg(long, value_name = "LEVEL", default_value = "info", value_parser = level)]
    pub(crate) messages: Messages,
    /// End when the first recording has ended, and take no other
    #[arg(long)]
    pub(crate) once: bool,
    /// The most MiB of each file; a sender is refused then
    #[arg(long, value_name = "MIB", value_parser = clap::value_parser!(u64).range(1..=1 << 40), allow_negative_numbers = true)]
    pub(crate) limit: Option<u64>,
    /// Show what comes in the browser, too: all senders on one time axis. ADDR is host:port
    #[arg(long, value_name = "ADDR", num_args = 0..=1, default_missing_value = SCOPE)]
    pub(crate) scope: Option<SocketAddr>,
    /// A picture of the machine in the scope, as of `luna scope`
    #[arg(long, value_name = "FILE", requires = "scope")]
    pub(crate) picture: Option<PathBuf>,
    /// The drawing of a model (.toml) in the scope, as of `luna scope`
    #[arg(
        long,
        value_name = "FILE",
        requires = "scope",
        conflicts_with = "picture"
    )]
    pub(crate) model: Option<PathBuf>,
}

/// Which messages are shown.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Messages(pub(crate) Option<luna::log::Level>);

fn level(text: &str) -> Result<Messages, String> {
    use luna::log::Level;
    Ok(Messages(match text {
        "none" => None,
        "error" => Some(Level::Error),
        "warn" => Some(Level::Warn),
        "info" => Some(Level::Info),
        "debug" => Some(Level::Debug),
        "trace" => Some(Level::Trace),
        _ => return Err("it must be error, warn, info, debug, trace or none".into()),
    }))
}

/// The options of `luna scope`.
#[derive(Debug, Clone, Args)]
pub(crate) struct Scope {
    /// The recording of the logger (.luna), as `System::log_to` or LUNA_LOG has made it; - reads it
    /// from the standard input. Several recordings, of programs that ran at the same time, are shown
    /// on one time axis
    #[arg(value_name = "FILES", required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// Where to listen; there is no encryption, so that what is no loopback is for a network that
    /// one trusts
    #[arg(long, value_name = "ADDR", default_value = SCOPE)]
    pub(crate) listen: SocketAddr,
    /// Answer under this name too, beside localhost and the address that was reached
    #[arg(long, value_name = "NAME")]
    pub(crate) host: Vec<String>,
    /// At most so many viewers
    #[arg(long, value_name = "N", default_value_t = 8, value_parser = clap::value_parser!(u8).range(1..))]
    pub(crate) viewers: u8,
    /// Play it so many times as fast as it was recorded, or max for all at once
    #[arg(long, value_name = "X", default_value = "1")]
    pub(crate) speed: luna_scope::Speed,
    /// Show this picture of the machine, too: an SVG whose elements are bound to signals (docs/scope-pictures.md)
    #[arg(long, value_name = "FILE")]
    pub(crate) picture: Option<PathBuf>,
    /// Show the drawing of this model (.toml), animated by the recorded events: what each process does
    /// and waits for, and how often each channel communicates
    #[arg(long, value_name = "FILE", conflicts_with = "picture")]
    pub(crate) model: Option<PathBuf>,
    /// End with the recording, instead of showing its end until Ctrl-C
    #[arg(long)]
    pub(crate) once: bool,
}

/// What a recording can be made to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum Format {
    /// A row for each instant, a column for each signal; messages in a second file
    Csv,
    /// For Foxglove, Lichtblick and PlotJuggler
    #[cfg(feature = "mcap")]
    Mcap,
    /// For ui.perfetto.dev
    Perfetto,
}

impl Format {
    /// How its files' names end.
    pub(crate) fn extension(self) -> &'static str {
        match self {
            Format::Csv => "csv",
            #[cfg(feature = "mcap")]
            Format::Mcap => "mcap",
            Format::Perfetto => "perfetto-trace",
        }
    }
}

/// Where the measured processes run, and how they are reported.
#[derive(Debug, Clone, Args)]
pub(crate) struct Placement {
    /// The core to run on [default: the last isolated one, else the last]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub(crate) core: Option<usize>,
    /// The scheduling policy: fifo:PRIORITY, rr:PRIORITY (1 to 97) or other
    #[arg(long, default_value = "fifo:80", value_parser = policy)]
    pub(crate) policy: Policy,
    /// Print one JSON object and nothing else
    #[arg(long)]
    pub(crate) json: bool,
}

pub(crate) fn seconds(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Err(_) => Err("it is not a number".into()),
        Ok(value) if value > 0.0 && value <= MAX_SECONDS => Ok(value),
        Ok(_) => Err(format!(
            "it must be more than 0 and at most {MAX_SECONDS} (a day)"
        )),
    }
}

pub(crate) fn instant(text: &str) -> Result<Duration, String> {
    let seconds = text.parse().ok().map(Duration::try_from_secs_f64);
    seconds
        .and_then(Result::ok)
        .ok_or("it must be a number of seconds, from 0 on".into())
}

/// Seconds, in ns.
fn offset(text: &str) -> Result<i64, String> {
    let seconds: Option<f64> = text.parse().ok();
    let nanos = seconds.map(|seconds| (seconds * 1e9).round());
    match nanos {
        // A century is enough, and its ns are exact to a µs.
        Some(nanos) if nanos.abs() < 3.2e18 => Ok(nanos as i64),
        _ => Err("it must be a number of seconds".into()),
    }
}

fn rate(text: &str) -> Result<u32, String> {
    match text.parse::<u32>() {
        Ok(value) if RATES.contains(&value) => Ok(value),
        _ => Err(format!(
            "it must be a whole number from {} to {}",
            RATES.start(),
            RATES.end()
        )),
    }
}

fn interval(text: &str) -> Result<u64, String> {
    match text.parse::<u64>() {
        Ok(value) if (1..=MAX_INTERVAL).contains(&value) => Ok(value),
        _ => Err(format!(
            "it must be a whole number of microseconds, from 1 to {MAX_INTERVAL} (a minute)"
        )),
    }
}

pub(crate) fn policy(text: &str) -> Result<Policy, String> {
    let policy: Policy = text.parse().map_err(|error| format!("{error}"))?;
    if policy.is_deadline() {
        return Err(
            "what is measured here shares an executor, which cannot have a deadline policy".into(),
        );
    }
    policy.validate_user().map_err(|error| format!("{error}"))?;
    Ok(policy)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(line: &str) -> Result<Command, clap::Error> {
        Arguments::try_parse_from(line.split_whitespace()).map(Arguments::command)
    }

    fn demo(line: &str) -> Demo {
        match parse(line) {
            Ok(Command::Demo(demos)) => demos.jiwy,
            other => panic!("{other:?}"),
        }
    }

    #[test]
    fn clap_is_content() {
        <Arguments as clap::CommandFactory>::command().debug_assert();
    }

    #[test]
    fn no_command_is_the_demo() {
        for line in ["luna", "luna demo"] {
            let demo = demo(line);
            assert_eq!(
                (demo.seconds, demo.rate, demo.cycles()),
                (10.0, 1000, 10_000)
            );
            assert_eq!(
                (demo.place.core, demo.place.policy, demo.place.json),
                (None, Policy::fifo(80), false)
            );
            assert_eq!(
                (demo.joystick.clone(), demo.period()),
                (None, Duration::from_millis(1))
            );
        }
        assert_eq!(demo("luna --seconds 2").cycles(), 2000);
    }

    #[test]
    fn demo_takes_its_options() {
        let demo = demo(
            "luna demo --seconds 0.5 --rate 250 --core 1 --policy rr:7 --joystick a.csv --json",
        );
        assert_eq!(
            (demo.cycles(), demo.period()),
            (125, Duration::from_millis(4))
        );
        assert_eq!(
            (demo.place.core, demo.place.policy, demo.place.json),
            (Some(1), Policy::round_robin(7), true)
        );
        assert_eq!(demo.joystick, Some(PathBuf::from("a.csv")));
        assert!(demo.parameters.is_none() && demo.set.is_empty());
    }

    #[test]
    fn demo_takes_parameters() {
        let demo = demo("luna --parameters jiwy.toml --set pan/kp=2 --set tilt/kd=0.1");
        assert_eq!(demo.parameters, Some(PathBuf::from("jiwy.toml")));
        assert_eq!(demo.set, ["pan/kp=2", "tilt/kd=0.1"]);
    }

    #[test]
    fn a_replay_says_all_that_the_recorded_run_was_told() {
        let recorded = demo("luna demo --seconds 1 --virtual --record run.replay");
        assert_eq!(recorded.record, Some(PathBuf::from("run.replay")));
        let replayed = demo("luna demo --replay run.replay --json");
        assert_eq!(replayed.replay, Some(PathBuf::from("run.replay")));
        assert!(replayed.place.json && replayed.record.is_none());
        for other in [
            "--seconds 1",
            "--rate 500",
            "--record b",
            "--calibrated",
            "--core 0",
            "--policy other",
            "--parameters jiwy.toml",
            "--set pan/kp=1",
            "--strict",
            "--table-4",
        ] {
            let line = format!("luna demo --replay run.replay {other}");
            assert_eq!(parse(&line).expect_err(&line).exit_code(), 2, "{line}");
        }
    }

    #[test]
    fn jitter_takes_its_options() {
        let Ok(Command::Jitter(jitter)) =
            parse("luna jitter --interval 500 --loops 20 --policy other --histogram h.csv")
        else {
            panic!("no jitter");
        };
        assert_eq!(
            (jitter.interval, jitter.loops, jitter.place.policy),
            (500, 20, Policy::Other)
        );
        assert_eq!(jitter.histogram, Some(PathBuf::from("h.csv")));
        assert_eq!((jitter.guard, jitter.others, jitter.burn), (0, 0, None));
        let Ok(Command::Jitter(jitter)) = parse("luna jitter --guard 60 --others 99 --burn 100")
        else {
            panic!("no jitter");
        };
        assert_eq!(
            (jitter.guard, jitter.others, jitter.burn),
            (60, 99, Some(100))
        );
    }

    #[test]
    fn doctor_takes_its_options() {
        let Ok(Command::Doctor(doctor)) = parse("luna doctor") else {
            panic!("no doctor");
        };
        assert_eq!((doctor.core, doctor.root), (None, None));
        assert!(!(doctor.quick || doctor.no_measure || doctor.no_self_test));
        let Ok(Command::Doctor(doctor)) =
            parse("luna doctor --core 3 --no-measure --no-self-test --root a --json --explain")
        else {
            panic!("no doctor");
        };
        assert_eq!((doctor.core, doctor.root), (Some(3), Some("a".into())));
        assert!(doctor.no_measure && doctor.no_self_test && doctor.json && doctor.explain);
    }

    #[test]
    fn record_takes_its_options() {
        let Ok(Command::Record(record)) = parse("luna record") else {
            panic!("no record");
        };
        assert_eq!(record.listen, "127.0.0.1:7411");
        assert_eq!(record.messages, Messages(Some(luna::log::Level::Info)));
        assert!(!record.udp && !record.once && record.output.is_none() && record.limit.is_none());
        let line = "luna record --listen 0.0.0.0:1 --udp -o a --messages none --once --limit 5";
        let Ok(Command::Record(record)) = parse(line) else {
            panic!("no record");
        };
        assert_eq!(
            (record.listen.as_str(), record.limit),
            ("0.0.0.0:1", Some(5))
        );
        assert_eq!(
            (record.messages, record.output),
            (Messages(None), Some("a".into()))
        );
        assert!(record.udp && record.once);
    }

    #[test]
    fn bad_values_are_named() {
        for (line, option) in [
            ("luna demo --rate 0", "--rate"),
            ("luna demo --rate 99", "--rate"),
            ("luna demo --rate 4001", "--rate"),
            ("luna demo --rate -1", "--rate"),
            ("luna demo --rate 1e3", "--rate"),
            ("luna demo --seconds 0", "--seconds"),
            ("luna demo --seconds -1", "--seconds"),
            ("luna demo --seconds nan", "--seconds"),
            ("luna demo --seconds inf", "--seconds"),
            ("luna demo --seconds ten", "--seconds"),
            ("luna demo --core one", "--core"),
            ("luna demo --core -1", "--core"),
            ("luna demo --policy fifo:98", "--policy"),
            ("luna demo --policy fifo:0", "--policy"),
            ("luna demo --policy fifo", "--policy"),
            ("luna --policy batch", "--policy"),
            ("luna jitter --interval 0", "--interval"),
            ("luna jitter --interval -5", "--interval"),
            ("luna jitter --interval 99999999999999999999", "--interval"),
            ("luna jitter --loops 0", "--loops"),
            ("luna jitter --loops -3", "--loops"),
            ("luna doctor --core -1", "--core"),
            ("luna jitter --guard -1", "--guard"),
            ("luna jitter --others 251", "--others"),
            ("luna jitter --burn 0", "--burn"),
            ("luna record --messages loud", "--messages"),
            ("luna record --limit 0", "--limit"),
            ("luna jitter --burn 1001", "--burn"),
            (
                "luna jitter --policy deadline:200000/1000000/1000000",
                "--policy",
            ),
        ] {
            let error = parse(line).expect_err(line);
            assert_eq!(error.exit_code(), 2, "{line}");
            assert!(error.to_string().contains(option), "{line}: {error}");
        }
        assert!(parse("luna --seconds 1 jitter").is_err());
    }
}
