//! The machine that is looked at: its files, and the core that is to be real-time.

use super::facts::{command_line, config};
use flate2::read::GzDecoder;
use luna_machine::facts::parse::core_list;
use luna_machine::facts::task::field;
use luna_machine::facts::{ClockResolution, Source, Unread, UnreadReason, parse};
use std::io::Read;

/// The files of a machine, and which of its cores is to run real-time executors.
#[derive(Debug)]
pub(crate) struct Machine {
    pub(crate) source: Source,
    /// The one asked for, else the last isolated one that this process may use, else the last one.
    pub(crate) core: usize,
    /// Not in files, so nothing for a copy of another machine's.
    pub(crate) clock: Option<ClockResolution>,
}

impl Machine {
    /// The machine of `source`, with `asked` as its real-time core.
    pub(crate) fn new(source: Source, asked: Option<usize>) -> Machine {
        let clock = if source.is_machine() {
            ClockResolution::of_this_machine()
        } else {
            None
        };
        let mut machine = Machine {
            source,
            core: 0,
            clock,
        };
        machine.core = asked.unwrap_or_else(|| machine.quietest());
        machine
    }

    fn quietest(&self) -> usize {
        let allowed = self.allowed().or_else(|_| self.online());
        crate::place::quietest(
            &allowed.unwrap_or_default(),
            &self.isolated().unwrap_or_default(),
        )
        .unwrap_or(0)
    }

    /// The cores that are switched on.
    pub(crate) fn online(&self) -> Result<Vec<usize>, Unread> {
        self.source
            .parse("/sys/devices/system/cpu/online", some_cores)
    }

    /// The cores that this process may use.
    pub(crate) fn allowed(&self) -> Result<Vec<usize>, Unread> {
        self.source.parse("/proc/self/status", |status| {
            some_cores(field(status, "Cpus_allowed_list")?)
        })
    }

    /// The cores that are kept free of ordinary threads.
    pub(crate) fn isolated(&self) -> Result<Vec<usize>, Unread> {
        self.source
            .parse("/sys/devices/system/cpu/isolated", core_list)
    }

    /// The cores without a periodic tick; none where the kernel cannot do it.
    pub(crate) fn tickless(&self) -> Result<Vec<usize>, Unread> {
        let file = "/sys/devices/system/cpu/nohz_full";
        missing_is(self.source.parse(file, core_list), Vec::new())
    }

    /// The cores on the kernel's command line under `key`, none if it has no such word.
    pub(crate) fn booted_with(&self, key: &str) -> Result<Vec<usize>, Unread> {
        let line = self.command_line()?;
        if command_line::value(&line, key).is_none() {
            return Ok(Vec::new());
        }
        let count = self.online().map_or(0, |cores| cores.len());
        command_line::cores(&line, key, count)
            .ok_or_else(|| Unread::new(COMMAND_LINE, UnreadReason::Malformed))
    }

    /// The kernel's command line.
    pub(crate) fn command_line(&self) -> Result<String, Unread> {
        self.source.read(COMMAND_LINE)
    }

    /// The value of an option of the kernel's configuration, `n` where it is not there, and the
    /// file that says so.
    pub(crate) fn option(&self, name: &str) -> Result<(String, String), Unread> {
        let (text, file) = self.config()?;
        Ok((config::option(&text, name).unwrap_or("n").to_owned(), file))
    }

    /// The kernel's configuration, and the file that it is from: the running kernel's own account
    /// of it, where there is one, else the file that its distribution has left.
    pub(crate) fn config(&self) -> Result<(String, String), Unread> {
        match self.unpacked_config() {
            Ok(text) => Ok((text, config::PACKED.to_owned())),
            Err(_) => config::text(&self.source),
        }
    }

    fn unpacked_config(&self) -> Result<String, Unread> {
        let packed = self.source.read_bytes(config::PACKED)?;
        let mut text = String::new();
        let unpacked = GzDecoder::new(&*packed)
            .take(MAX_CONFIG)
            .read_to_string(&mut text);
        match unpacked {
            Ok(size) if size > 0 => Ok(text),
            _ => Err(Unread::new(config::PACKED, UnreadReason::Malformed)),
        }
    }

    /// The kernel's version: its first two numbers.
    pub(crate) fn kernel_version(&self) -> Result<(u32, u32), Unread> {
        let file = "/proc/sys/kernel/osrelease";
        self.source.parse(file, parse::kernel_version)
    }

    /// The cores other than the real-time one, as the kernel writes lists; for advice.
    pub(crate) fn other_cores(&self) -> String {
        let mut cores = self.online().unwrap_or_default();
        cores.retain(|core| *core != self.core);
        match cores.is_empty() {
            true => "OTHER_CORES".to_owned(),
            false => parse::write_core_list(&cores),
        }
    }

    /// The processes (their numbers) that have a `comm` of `name`, kernel threads included.
    pub(crate) fn processes_called(&self, name: &str) -> Result<Vec<String>, Unread> {
        let mut numbers = self.source.list("/proc")?;
        numbers.retain(|number| {
            number.bytes().all(|byte| byte.is_ascii_digit())
                && self.source.word(&format!("/proc/{number}/comm")).as_deref() == Ok(name)
        });
        Ok(numbers)
    }
}

const COMMAND_LINE: &str = "/proc/cmdline";

/// No kernel's configuration has more bytes: a real one has some 300 000.
const MAX_CONFIG: u64 = 16 << 20;

/// A list of cores that has at least one.
fn some_cores(text: &str) -> Option<Vec<usize>> {
    core_list(text).filter(|cores| !cores.is_empty())
}

/// Takes a missing file for `value`: one that only some kernels have.
pub(crate) fn missing_is<T>(outcome: Result<T, Unread>, value: T) -> Result<T, Unread> {
    match outcome {
        Err(unread) if unread.reason == UnreadReason::Missing => Ok(value),
        outcome => outcome,
    }
}
