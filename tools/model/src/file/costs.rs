//! Reads a file of costs: a table for each process, with its longest job and its longest poll.

use crate::language::body::Named;
use crate::text::{Problem, Source};
use luna::file::{entries, parse, time};
use std::time::Duration;

/// What a table states.
#[derive(Debug)]
pub(crate) struct Stated {
    pub(crate) process: Named,
    pub(crate) cost: Option<Duration>,
    pub(crate) longest_poll: Option<Duration>,
}

pub(crate) fn read(source: Source<'_>) -> Result<Vec<Stated>, Problem> {
    let table = parse(source)?;
    let mut all = Vec::new();
    for process in entries(source, table.get_ref()) {
        let (mut cost, mut longest_poll) = (None, None);
        for entry in process.table()? {
            match entry.key {
                "cost" => cost = Some(time(&entry)?),
                "longest_poll" => longest_poll = Some(time(&entry)?),
                _ => return Err(entry.unknown(&["cost", "longest_poll"])),
            }
        }
        if cost
            .zip(longest_poll)
            .is_some_and(|(cost, poll)| poll > cost)
        {
            let message = "the longest poll of this process is longer than its cost";
            let advice = "`cost` is the time of all polls of a cycle: raise it";
            return Err(source.problem(process.key_span(), message, advice));
        }
        all.push(Stated {
            process: process.named(),
            cost,
            longest_poll,
        });
    }
    Ok(all)
}
