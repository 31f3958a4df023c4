//! `/proc/stat`, kept open.

use crate::facts::parse::stolen_ticks;
use nix::unistd::{SysconfVar, sysconf};
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::time::Duration;

/// Reads the stolen time. Not for the real-time path: the kernel writes a text of all cores and
/// interrupts for each reading, which takes tens of microseconds.
///
/// ```
/// use luna_machine::steal::StealMeter;
///
/// if let Some(mut meter) = StealMeter::open() {
///     let earlier = meter.read();
///     assert!(earlier.iter().zip(&meter.read()).all(|(before, after)| before.1 <= after.1));
/// }
/// ```
#[derive(Debug)]
pub struct StealMeter {
    file: File,
    ticks_per_second: u64,
    text: String,
}

impl StealMeter {
    /// Opens the source; `None` where the system has none.
    pub fn open() -> Option<StealMeter> {
        Self::open_at(Path::new("/proc/stat"))
    }

    /// Opens a file in the format of the kernel's; for tests.
    #[doc(hidden)]
    pub fn open_at(path: &Path) -> Option<StealMeter> {
        let ticks = sysconf(SysconfVar::CLK_TCK).ok().flatten()?;
        let mut meter = StealMeter {
            file: File::open(path).ok()?,
            ticks_per_second: u64::try_from(ticks).ok().filter(|&ticks| ticks > 0)?,
            text: String::new(),
        };
        // A container may show a file without the column.
        (!meter.read().is_empty()).then_some(meter)
    }

    /// The cores that are switched on, by the system's number of each, and what was stolen from
    /// each since the machine began. The kernel gives it in steps of 10 ms on most machines. Empty
    /// if the source cannot be read any more.
    pub fn read(&mut self) -> Vec<(usize, Duration)> {
        self.try_read().unwrap_or_default()
    }

    fn try_read(&mut self) -> Option<Vec<(usize, Duration)>> {
        self.text.clear();
        self.file.rewind().ok()?;
        self.file.read_to_string(&mut self.text).ok()?;
        let tick = Duration::from_secs(1) / u32::try_from(self.ticks_per_second).ok()?;
        let cores = self.text.lines().filter_map(stolen_ticks);
        let stolen = cores.map(|(core, ticks)| {
            let ticks = u32::try_from(ticks).unwrap_or(u32::MAX);
            (core, tick * ticks)
        });
        Some(stolen.collect())
    }
}
