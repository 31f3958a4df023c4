//! `luna echo`: the values of a channel or blackboard, as they come.

use super::{broken_off, ended, refused, wait_for};
use crate::args;
use crate::failure::{Failure, unusable};
use clap::Args;
use glob::Pattern;
use luna::prelude::*;
use luna_ipc::any::{AnyError, AnyType, AnyValue};
use luna_ipc::look::{self, Found, Kind};
use luna_ipc::{Endpoint, TypeInfo};
use serde_json::json;
use std::collections::HashMap;
use std::io::{self, Write};
use std::process::ExitCode;
use std::sync::mpsc::{self, RecvTimeoutError};
use std::time::Duration;

/// The options of `luna echo`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Of a channel it IS the receiving program: it takes each value, and the sender goes on. So it needs a channel without a receiver,
and when it ends the channel closes for the sender, as with any other receiver. To look at a channel that has a receiver, use
`luna list NAME`: its numbers and rates are seen from outside, its values are not.

Of a blackboard it looks from outside, and prints a value of each key that has changed since it looked last.

Types: numbers, bool, char, arrays of these, and serde's String. Others only as bytes, by --raw. Calls and loans cannot be echoed.

Exit codes: 0 the sender has closed, --count, or Ctrl-C; 1 the other program has ended without closing it, or has poisoned it;
2 nothing has that name, it has a receiver, or its values cannot be printed.

JSON, one object a value: number, value; of a blackboard also key and age_s.")]
pub(crate) struct Arguments {
    /// The channel or blackboard
    name: String,
    /// Of a blackboard, only these keys, as speed,pan/*
    #[arg(value_name = "KEYS", value_delimiter = ',')]
    keys: Vec<Pattern>,
    /// End after so many values
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u64).range(1..), allow_negative_numbers = true)]
    count: Option<u64>,
    /// Wait at most so many seconds for a program that opens the channel
    #[arg(long, value_name = "S", default_value = "0", value_parser = args::instant)]
    wait: Duration,
    /// Of a blackboard: look each so many seconds
    #[arg(long, value_name = "S", default_value = "0.01", value_parser = args::seconds, allow_negative_numbers = true)]
    every: f64,
    /// Print the bytes of a value, as they lie in memory, whatever its type is
    #[arg(long)]
    raw: bool,
    /// Print a JSON object for each value
    #[arg(long)]
    json: bool,
}

/// Prints them.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let found = wait_for(&arguments.name, arguments.wait)?;
    match found.kind {
        Kind::Blackboard => board(arguments, found),
        _ if !arguments.keys.is_empty() => Err(unusable(
            &arguments.name,
            "it is no blackboard, and has no keys",
        )),
        _ => channel(arguments, &found),
    }
}

fn of(arguments: &Arguments, info: &TypeInfo) -> Result<AnyType, Failure> {
    let of = match arguments.raw {
        true => AnyType::raw(info),
        false => AnyType::of(info),
    };
    of.map_err(|error| match error {
        AnyError::Form { .. } => unusable(&arguments.name, format_args!("{error}, with --raw")),
        error => unusable(&arguments.name, error),
    })
}

fn channel(arguments: &Arguments, found: &Found) -> Result<ExitCode, Failure> {
    let name = &arguments.name;
    let of = of(arguments, &found.value)?;
    let opened = Endpoint::new(name).any_receiver(&of);
    let (receiver, link) = opened.map_err(|error| refused(name, &error))?;
    let status = link.status();
    let (json, count) = (arguments.json, arguments.count);
    let (failed, failure) = mpsc::channel();
    let mut system = System::new("luna echo");
    let main = system.executor("main").policy(Policy::Other).build()?;
    main.process("link").spawn(link)?;
    let prints = async move {
        let mut left = count.unwrap_or(u64::MAX);
        while left > 0
            && let Ok(value) = receiver.recv_extended().await
        {
            // It is acknowledged when it was printed.
            let line = match json {
                true => json!({"number": status.number() + 1, "value": &*value}).to_string(),
                false => value.to_string(),
            };
            if let Err(error) = print(&line) {
                let _ = failed.send(error);
                break;
            }
            left -= 1;
        }
        Ok(())
    };
    main.process("print").spawn(prints)?;
    drop(main);
    let ran = system.run();
    if let Ok(error) = failure.try_recv() {
        return Err(Failure::Output(error));
    }
    ran.map_err(|error| ended(name, error))?;
    Ok(ExitCode::SUCCESS)
}

fn print(line: &str) -> io::Result<()> {
    let mut out = io::stdout().lock();
    writeln!(out, "{line}")?;
    out.flush()
}

fn board(arguments: &Arguments, mut found: Found) -> Result<ExitCode, Failure> {
    let name = &arguments.name;
    let is_meant = |key: &look::Key| {
        let keys = &arguments.keys;
        keys.is_empty() || keys.iter().any(|pattern| pattern.matches(&key.key))
    };
    let Some(width) = found
        .keys
        .iter()
        .filter(|key| is_meant(key))
        .map(|key| key.key.len())
        .max()
    else {
        let keys: Vec<&str> = found.keys.iter().map(|key| &*key.key).collect();
        return Err(unusable(
            name,
            format_args!("it has no such key; there are {}", keys.join(", ")),
        ));
    };
    let (end, ends) = mpsc::channel();
    crate::record::signals::notify(end);
    let mut types: HashMap<String, AnyType> = HashMap::new();
    let mut numbers: HashMap<String, u64> = HashMap::new();
    let mut left = arguments.count.unwrap_or(u64::MAX);
    loop {
        for key in found.keys.iter().filter(|key| is_meant(key)) {
            // A later writer may have begun anew. Without bytes it was not read whole: the next
            // look may be luckier.
            let is_new = numbers.get(&key.key) != Some(&key.number);
            if !is_new || key.bytes.len() as u64 != key.value.size {
                continue;
            }
            let known = types.get(&key.key).filter(|of| *of.info() == key.value);
            let of = match known {
                Some(of) => of.clone(),
                None => of(arguments, &key.value)?,
            };
            let value = of.read(&key.bytes).map_err(|error| unusable(name, error))?;
            print(&line(arguments, key, &value, width)).map_err(Failure::Output)?;
            types.insert(key.key.clone(), of);
            numbers.insert(key.key.clone(), key.number);
            left -= 1;
            if left == 0 {
                return Ok(ExitCode::SUCCESS);
            }
        }
        match ends.recv_timeout(Duration::from_secs_f64(arguments.every)) {
            Err(RecvTimeoutError::Timeout) => {}
            _ => return Ok(ExitCode::SUCCESS),
        }
        let next = look::at(name).map_err(|error| unusable(name, error))?;
        found = match next {
            Some(next) if next.kind == Kind::Blackboard && next.is_alive() => next,
            Some(next) if next.is_alive() => {
                return Err(broken_off(name, "it is no blackboard any more"));
            }
            Some(_) => {
                return Err(broken_off(
                    name,
                    "the programs that had it open were killed",
                ));
            }
            // All have closed it.
            None => return Ok(ExitCode::SUCCESS),
        };
    }
}

fn line(arguments: &Arguments, key: &look::Key, value: &AnyValue, width: usize) -> String {
    match arguments.json {
        true => {
            let age = luna::Instant::now().nanos_since(key.set) as f64 / 1e9;
            json!({"key": key.key, "number": key.number, "value": value, "age_s": age}).to_string()
        }
        false => format!("{:width$}  {value}", key.key),
    }
}
