//! `luna send`: values to a channel, or to a key of a blackboard.

use super::{broken_off, ended, refused, wait_for};
use crate::args;
use crate::failure::{Failure, unusable};
use crate::text::Count;
use clap::Args;
use futures_lite::future;
use luna::Process;
use luna::prelude::*;
use luna_ipc::any::{self, AnyType, AnyValue};
use luna_ipc::look::{Found, Kind};
use luna_ipc::{Endpoint, SendLink};
use std::process::ExitCode;
use std::sync::mpsc;
use std::time::Duration;

/// The options of `luna send`.
#[derive(Debug, Clone, Args)]
#[command(after_help = "\
Of a channel it IS the sending program: so it needs a channel without a sender, and when it ends the channel closes for the
receiver, as with any other sender. A value was sent when a process of the other program has taken it.

Of a blackboard, VALUES are KEY=VALUE. It needs one without a writer that readers have open: it is the writer for so long.

A value is a number, true or false, a character, the elements of an array as [1, 2] or \"1 2\", or a text for serde's String; -- before
those that begin with a minus and are no number.

Exit codes: 0 all were taken; 1 one was not, in the time of --timeout or before the other program ended; 2 nothing has that name, it
has a sender, or a value is none of its type: then nothing is sent.")]
pub(crate) struct Arguments {
    /// The channel or blackboard
    name: String,
    /// What is sent, one after the other
    #[arg(value_name = "VALUES", required = true, allow_negative_numbers = true)]
    values: Vec<String>,
    /// How long each value may wait until it is taken, in seconds
    #[arg(long, value_name = "S", default_value = "5", value_parser = args::seconds, allow_negative_numbers = true)]
    timeout: f64,
    /// Wait at most so many seconds for a program that opens the channel
    #[arg(long, value_name = "S", default_value = "0", value_parser = args::instant)]
    wait: Duration,
}

/// Sends them.
pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let found = wait_for(&arguments.name, arguments.wait)?;
    match found.kind {
        Kind::Blackboard => set(arguments, &found),
        _ => send(arguments, &found),
    }
}

fn set(arguments: &Arguments, found: &Found) -> Result<ExitCode, Failure> {
    let name = &arguments.name;
    let values = arguments.values.iter().map(|text| {
        let (key, text) = text.split_once('=').ok_or_else(|| {
            unusable(
                name,
                format_args!("it is a blackboard: `{text}` is to be KEY=VALUE"),
            )
        })?;
        let known = found.keys.iter().find(|one| one.key == key);
        let known = known.ok_or_else(|| {
            let keys: Vec<&str> = found.keys.iter().map(|one| &*one.key).collect();
            let keys = keys.join(", ");
            unusable(
                name,
                format_args!("it has no key `{key}`; there are {keys}"),
            )
        })?;
        let of = AnyType::of(&known.value).map_err(|error| unusable(name, error))?;
        let value = of.parse(text).map_err(|error| unusable(name, error))?;
        Ok((key, value))
    });
    for (key, value) in values.collect::<Result<Vec<_>, Failure>>()? {
        any::set(name, key, &value).map_err(|error| refused(name, &error))?;
    }
    Ok(ExitCode::SUCCESS)
}

/// How the sending ended.
enum End {
    Sent,
    /// So many were taken, and the next was not in time.
    Late(usize),
    /// The receiver has closed the channel before the next was taken.
    Closed(usize),
}

fn send(arguments: &Arguments, found: &Found) -> Result<ExitCode, Failure> {
    let name = &arguments.name;
    let of = AnyType::of(&found.value).map_err(|error| unusable(name, error))?;
    let values = arguments.values.iter().map(|text| of.parse(text));
    let values: Result<Vec<AnyValue>, _> = values.collect();
    let values = values.map_err(|error| unusable(name, error))?;
    let all = values.len();
    let opened = Endpoint::new(name).any_sender(&of);
    let (sender, link) = opened.map_err(|error| refused(name, &error))?;
    let status = link.status();
    let timeout = Duration::from_secs_f64(arguments.timeout);
    let (end, ends) = mpsc::channel();
    let mut system = System::new("luna send");
    let main = system.executor("main").policy(Policy::Other).build()?;
    let sends = async move {
        let _ = end.send(carry(values, sender, link, timeout).await?);
        Ok(())
    };
    main.process("send").spawn(sends)?;
    drop(main);
    system.run().map_err(|error| ended(name, error))?;
    let seconds = arguments.timeout;
    match ends.try_recv() {
        Ok(End::Sent) => Ok(ExitCode::SUCCESS),
        Ok(End::Late(0)) if !status.has_joined() => Err(broken_off(
            name,
            format_args!("its receiver has not joined in {seconds} s: nothing was sent"),
        )),
        Ok(End::Late(taken)) => Err(broken_off(
            name,
            format_args!(
                "value {} of {all} was not taken in {seconds} s, and is withdrawn: give the receiver longer by --timeout, or look what it does by `luna list {name}`",
                taken + 1
            ),
        )),
        Ok(End::Closed(taken)) => Err(broken_off(
            name,
            format_args!(
                "its receiver has closed it: it has taken {taken} of {}",
                Count(all as u64, "value")
            ),
        )),
        // A signal came first.
        Err(_) => Err(broken_off(
            name,
            "it was ended before all values were taken",
        )),
    }
}

/// Sends the values by the link. What is under way is withdrawn when the link is dropped.
async fn carry(
    values: Vec<AnyValue>,
    sender: Sender<AnyValue>,
    mut link: SendLink<AnyValue>,
    timeout: Duration,
) -> luna::Result<End> {
    link.pre_run()?;
    let sends = async {
        for (taken, value) in values.into_iter().enumerate() {
            let sent = async { sender.send(value).await.map_err(|_| End::Closed(taken)) };
            let late = async {
                luna::after(timeout).await;
                Err(End::Late(taken))
            };
            future::or(sent, late).await?;
        }
        Ok(End::Sent)
    };
    // Its error, or poison, is more than that the channel is closed: so it comes first.
    let run = async {
        link.run().await?;
        std::future::pending().await
    };
    let sends = async { Ok(sends.await.unwrap_or_else(|end| end)) };
    future::or(run, sends).await
}
