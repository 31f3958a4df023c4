//! `/proc/stat`, kept open.

use crate::facts::parse::stolen_ticks;
use nix::unistd::{SysconfVar, sysconf};
use std::fs::File;
use std::io::{Read, Seek};
use std::path::Path;
use std::time::Duration;

#[derive(Debug)]
pub(crate) struct Source {
    file: File,
    ticks_per_second: u64,
    text: String,
}

pub(crate) fn open() -> Option<Source> {
    open_at(Path::new("/proc/stat"))
}

pub(crate) fn open_at(path: &Path) -> Option<Source> {
    let ticks = sysconf(SysconfVar::CLK_TCK).ok().flatten()?;
    let mut source = Source {
        file: File::open(path).ok()?,
        ticks_per_second: u64::try_from(ticks).ok().filter(|&ticks| ticks > 0)?,
        text: String::new(),
    };
    // A container may show a file without the column.
    read(&mut source).filter(|cores| !cores.is_empty())?;
    Some(source)
}

pub(crate) fn read(source: &mut Source) -> Option<Vec<(usize, Duration)>> {
    source.text.clear();
    source.file.rewind().ok()?;
    source.file.read_to_string(&mut source.text).ok()?;
    let tick = Duration::from_secs(1) / u32::try_from(source.ticks_per_second).ok()?;
    let cores = source.text.lines().filter_map(stolen_ticks);
    Some(
        cores
            .map(|(core, ticks)| (core, tick * u32::try_from(ticks).unwrap_or(u32::MAX)))
            .collect(),
    )
}
