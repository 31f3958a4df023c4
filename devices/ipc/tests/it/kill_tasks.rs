//! What the programs do that are killed at random instants: session after session, until there is a
//! file `stop`. The one has unique numbers acknowledged, and notes those. The other notes each
//! number that it takes, before the first goes on.

use crate::child::{Log, now};
use futures_lite::future;
use luna::channel::{Client, Server};
use luna::prelude::*;
use luna::system::Executor;
use luna_ipc::{Endpoint, IpcError, Lent, Loan, Loans, Status};
use std::path::{Path, PathBuf};
use std::time::Duration;

/// The tasks of two programs: the first has numbers acknowledged, the second takes them.
pub(crate) const PAIRS: [[&str; 2]; 3] =
    [["send", "receive"], ["call", "serve"], ["lend", "borrow"]];

/// Spawns one of the tasks.
pub(crate) fn spawn(task: &str, executor: &Executor, name: String, folder: PathBuf) {
    let process = executor.process("sessions");
    let spawned = match task {
        "send" => process.spawn(move || gives::<Sends>(name, folder)),
        "receive" => process.spawn(move || takes::<Receives>(name, folder)),
        "call" => process.spawn(move || gives::<Calls>(name, folder)),
        "serve" => process.spawn(move || takes::<Serves>(name, folder)),
        "lend" => process.spawn(move || gives::<Lends>(name, folder)),
        "borrow" => process.spawn(move || takes::<Borrows>(name, folder)),
        task => panic!("no task `{task}`"),
    };
    spawned.unwrap();
}

/// How often the links of this program look: in every other program.
pub(crate) fn looks() -> u32 {
    std::process::id() % 2 * 100
}

/// A side of a channel, its link, and the link's counts.
type Opened<E, L> = Result<(E, L, Status), IpcError>;

macro_rules! opened {
    ($end:expr, $link:expr) => {{
        let link = $link.looks(looks());
        let status = link.status();
        Ok(($end, link, status))
    }};
}

trait Gives: Sized + Send + Sync + 'static {
    fn open(at: Endpoint) -> Opened<Self, impl Process + Send + 'static>;
    /// Whether the other program has acknowledged it.
    fn give(&self, number: u64) -> impl Future<Output = bool> + Send;
}

trait Takes: Sized + Send + Sync + 'static {
    fn open(at: Endpoint) -> Opened<Self, impl Process + Send + 'static>;
    /// Notes a number, then acknowledges it. False if the session is over.
    fn take(&self, taken: &mut Log) -> impl Future<Output = bool> + Send;
}

struct Sends(Sender<u64>);

impl Gives for Sends {
    fn open(at: Endpoint) -> Opened<Self, impl Process + Send + 'static> {
        let (sender, link) = at.sender()?;
        opened!(Self(sender), link)
    }

    async fn give(&self, number: u64) -> bool {
        self.0.send(number).await.is_ok()
    }
}

struct Receives(Receiver<u64>);

impl Takes for Receives {
    fn open(at: Endpoint) -> Opened<Self, impl Process + Send + 'static> {
        let (receiver, link) = at.receiver()?;
        opened!(Self(receiver), link)
    }

    async fn take(&self, taken: &mut Log) -> bool {
        let received = self.0.recv_extended().await;
        received.map(|value| taken.add([*value])).is_ok()
    }
}

struct Calls(Client<u64, u64>);

impl Gives for Calls {
    fn open(at: Endpoint) -> Opened<Self, impl Process + Send + 'static> {
        let (client, link) = at.client()?;
        opened!(Self(client), link)
    }

    async fn give(&self, number: u64) -> bool {
        let answer = self.0.call(number).await;
        answer.is_ok_and(|answer| {
            assert_eq!(answer, !number, "the answer of another call");
            true
        })
    }
}

struct Serves(Server<u64, u64>);

impl Takes for Serves {
    fn open(at: Endpoint) -> Opened<Self, impl Process + Send + 'static> {
        let (server, link) = at.server()?;
        opened!(Self(server), link)
    }

    async fn take(&self, taken: &mut Log) -> bool {
        let Ok(call) = self.0.accept().await else {
            return false;
        };
        let number = *call;
        taken.add([number]);
        call.reply(!number).is_ok()
    }
}

/// A lent value has several words, so that a part of another one would be seen.
type Lendable = [u64; 64];

struct Lends(Loans<Lendable>, Sender<Loan<Lendable>>);

impl Gives for Lends {
    fn open(at: Endpoint) -> Opened<Self, impl Process + Send + 'static> {
        let (loans, sender, link) = at.loan_sender(2, &[0; 64])?;
        opened!(Self(loans, sender), link)
    }

    async fn give(&self, number: u64) -> bool {
        // The other program may still hold the value before, and no other.
        let mut loan = self.0.loan().expect("there are two places");
        *loan = [number; 64];
        self.1.send(loan).await.is_ok()
    }
}

struct Borrows(Receiver<Lent<Lendable>>);

impl Takes for Borrows {
    fn open(at: Endpoint) -> Opened<Self, impl Process + Send + 'static> {
        let (receiver, link) = at.loan_receiver(2)?;
        opened!(Self(receiver), link)
    }

    async fn take(&self, taken: &mut Log) -> bool {
        let Ok(lent) = self.0.recv_extended().await else {
            return false;
        };
        assert_eq!(**lent, [lent[0]; 64], "parts of two values");
        taken.add([lent[0]]);
        true
    }
}

async fn gives<E: Gives>(name: String, folder: PathBuf) -> luna::Result<()> {
    let mut acknowledged = Log::open(folder.join("acknowledged"));
    let mut next = u64::from(std::process::id()) << 32;
    sessions(&name, &folder, E::open, async |end: &E| {
        next += 1;
        let given = end.give(next).await;
        if given {
            acknowledged.add([next]);
        }
        given
    })
    .await
}

async fn takes<E: Takes>(name: String, folder: PathBuf) -> luna::Result<()> {
    let mut taken = Log::open(folder.join("taken"));
    sessions(&name, &folder, E::open, async |end: &E| {
        end.take(&mut taken).await
    })
    .await
}

/// Opens, and calls `step` until it says that the session is over; then again.
async fn sessions<E: Send + 'static, L: Process + Send + 'static>(
    name: &str,
    folder: &Path,
    open: fn(Endpoint) -> Opened<E, L>,
    mut step: impl AsyncFnMut(&E) -> bool,
) -> luna::Result<()> {
    let mut ends = Log::open(folder.join("ends"));
    let stop = folder.join("stop");
    while !stop.exists() {
        let endpoint = Endpoint::new(name);
        let (end, mut link, status) = luna::blocking(move || open(endpoint)).await?;
        let work = async {
            let is_stopped = async {
                stopped(&stop).await;
                None
            };
            let steps = async {
                while !stop.exists() {
                    if !step(&end).await {
                        return status.partner();
                    }
                }
                None
            };
            if let Some(partner) = future::or(steps, is_stopped).await {
                ends.add([u64::from(partner), now(), u64::from(looks())]);
            }
            drop(end);
            Ok::<(), luna::Error>(())
        };
        let run = async {
            let _ = link.run().await;
            Ok::<(), luna::Error>(())
        };
        par!(run, work).await?;
        luna::blocking(move || drop(link)).await;
    }
    Ok(())
}

/// Looks now and then, for the end of the test alone.
async fn stopped(stop: &Path) {
    while !stop.exists() {
        luna::after(Duration::from_millis(20)).await;
    }
}
