//! Reads a system file.

use super::stated::Stated;
use crate::file::{Problem, Source};

/// What the file states, or what is wrong in it; an error if this program reads no TOML.
pub(super) fn read(source: Source<'_>) -> Result<Result<Stated, Problem>, String> {
    #[cfg(feature = "toml")]
    return Ok(toml::read(source));
    #[cfg(not(feature = "toml"))]
    {
        let Source { .. } = source;
        Err(crate::file::NO_TOML.to_owned())
    }
}

#[cfg(feature = "toml")]
mod toml {
    use crate::deployment::stated::{At, Loop, Named, Process, Stated, Thread};
    use crate::deployment::{LONGEST_LOOP_NAME, WORDS};
    use crate::file::{self, Entry, MAX_PRIORITY, Problem, Source, entries, parse};
    use luna_platform::spin::LONGEST;
    use luna_platform::thread::{MAXIMUM_STACK_SIZE, MINIMUM_STACK_SIZE};
    use std::sync::atomic::AtomicU64;
    use std::time::Duration;

    pub(super) fn read(source: Source<'_>) -> Result<Stated, Problem> {
        let table = parse(source)?;
        let mut stated = Stated::default();
        for entry in entries(source, table.get_ref()) {
            match entry.key {
                "system" => system(&entry, &mut stated)?,
                "executor" => stated.threads = named(&entry, thread)?,
                "process" => stated.processes = named(&entry, process)?,
                "loop" => stated.loops = named(&entry, one_loop)?,
                _ => return Err(entry.unknown(&["system", "executor", "process", "loop"])),
            }
        }
        Ok(stated)
    }

    fn at<T>(entry: &Entry<'_>, value: T) -> Option<At<T>> {
        let span = entry.span();
        Some(At { value, span })
    }

    /// The tables below this one, by their names.
    fn named<'t, T>(
        entry: &Entry<'t>,
        read: impl Fn(&Entry<'t>) -> Result<T, Problem>,
    ) -> Result<Vec<Named<T>>, Problem> {
        let one = |entry: Entry<'t>| {
            let (value, span) = entry.named();
            Ok((At { value, span }, read(&entry)?))
        };
        entry.table()?.into_iter().map(one).collect()
    }

    fn system(entry: &Entry<'_>, stated: &mut Stated) -> Result<(), Problem> {
        for entry in entry.table()? {
            match entry.key {
                "strict" => stated.strict = at(&entry, entry.bool()?),
                "lock_memory" => stated.lock_memory = at(&entry, entry.bool()?),
                _ => return Err(entry.unknown(&["strict", "lock_memory"])),
            }
        }
        Ok(())
    }

    fn thread(entry: &Entry<'_>) -> Result<Thread, Problem> {
        let mut found = Thread::default();
        for entry in entry.table()? {
            match entry.key {
                "core" => found.core = at(&entry, file::core(&entry)?.map(usize::from)),
                "policy" => found.policy = at(&entry, file::policy(&entry)?),
                "spin_before_sleep" => found.spin_before_sleep = at(&entry, spin(&entry)?),
                "stack_size" => {
                    let range = MINIMUM_STACK_SIZE as i64..=MAXIMUM_STACK_SIZE as i64;
                    found.stack_size = at(&entry, entry.number(range)? as usize);
                }
                _ => {
                    let known = ["core", "policy", "spin_before_sleep", "stack_size"];
                    return Err(entry.unknown(&known));
                }
            }
        }
        Ok(found)
    }

    fn spin(entry: &Entry<'_>) -> Result<Duration, Problem> {
        let time = file::time_or_none(entry)?;
        if time > LONGEST {
            let advice = format!("write `0 us` to `{} us`", LONGEST.as_micros());
            return Err(entry.problem("this is too long to look for work", advice));
        }
        Ok(time)
    }

    fn process(entry: &Entry<'_>) -> Result<Process, Problem> {
        let mut found = Process::default();
        for entry in entry.table()? {
            match entry.key {
                "on" => found.on = at(&entry, entry.text()?.to_owned()),
                "priority" => {
                    found.priority = at(&entry, entry.number(0..=MAX_PRIORITY)? as u8);
                }
                "poll_budget" => found.poll_budget = at(&entry, file::time(&entry)?),
                "cycle_budget" => found.cycle_budget = at(&entry, file::time(&entry)?),
                "on_overrun" => found.on_overrun = at(&entry, entry.one_of(&WORDS)?),
                "period" => {
                    let message = "a period is that of a loop, and a process may have several";
                    let advice = "write `period` below `[loop.NAME]`, with the loop's name";
                    return Err(entry.source.problem(entry.key_span(), message, advice));
                }
                _ => {
                    let known = [
                        "on",
                        "priority",
                        "poll_budget",
                        "cycle_budget",
                        "on_overrun",
                    ];
                    return Err(entry.unknown(&known));
                }
            }
        }
        Ok(found)
    }

    fn one_loop(entry: &Entry<'_>) -> Result<Loop, Problem> {
        let wrong = |message: &str, advice: String| {
            Err(entry.source.problem(entry.key_span(), message, advice))
        };
        let most = LONGEST_LOOP_NAME;
        if entry.key.len() > most {
            let advice = format!("it has at most {most} bytes");
            return wrong("no loop has a name as long", advice);
        }
        let mut period = None;
        for entry in entry.table()? {
            match entry.key {
                "period" => period = at(&entry, file::time(&entry)?),
                _ => return Err(entry.unknown(&["period"])),
            }
        }
        let Some(period) = period else {
            let advice = "write its `period`".to_owned();
            return wrong("nothing is stated of this loop", advice);
        };
        Ok(Loop {
            period,
            program: AtomicU64::new(0),
        })
    }
}
