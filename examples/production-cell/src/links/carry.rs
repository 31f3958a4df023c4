//! Carries values between a unit's ends and a channel to another program.
//!
//! A unit's end is an ordinary channel of its own program. A process carries the values between it
//! and the other program. When that ends, however it does, the process opens the channel again, and
//! goes on when the program was started again. So a unit's ends never break.
//!
//! A value of a rendezvous is kept until the other program has taken it, also over its restart. It
//! may come twice then, if the program was killed between taking and acknowledging it: a
//! [`Handed`](crate::messages::Handed) has a number for that. Newest values are not kept.

use super::Style;
use crate::messages::Message;
use futures_lite::future;
use luna::channel::{ChannelEnd, Extended};
use luna::system::Executor;
use luna::{Process, Receiver, Sender};
use std::time::Duration;

/// On the executor of its unit: above the operator's requests, below what moves.
const LEVEL: u8 = 8;
/// Before the next attempt to open a channel that could not be opened.
const PAUSE: Duration = Duration::from_millis(20);
/// So often it is tried.
const ATTEMPTS: u32 = 100;
/// How long the last values may take after the unit has ended.
const GRACE: Duration = Duration::from_millis(200);

/// A channel to another program, which can be opened again and again.
pub(super) trait Remote: Clone + Send + 'static {
    fn open_sender<T: Message>(self) -> luna::Result<(Sender<T>, impl Process + Send + 'static)>;

    /// What arrives: a value, with what the channel says of it.
    type Arrived<T: Message>: Send + 'static;

    fn open_receiver<T: Message>(
        self,
    ) -> luna::Result<(Receiver<Self::Arrived<T>>, impl Process + Send + 'static)>;

    /// The value, as the unit is to get it.
    fn value<T: Message>(arrived: &Self::Arrived<T>) -> T;
}

/// The unit's end of a channel that leads to `remote`.
pub(super) fn sender<T: Message>(
    executor: &Executor,
    name: &str,
    remote: impl Remote,
    style: Style,
) -> luna::Result<Sender<T>> {
    let (sender, local) = style.channel(name);
    let process = executor.process(format!("link to {name}"));
    let body = move || carry_out::<T>(remote, local, style);
    process.priority(LEVEL).spawn(body)?;
    Ok(sender)
}

/// The unit's end of a channel that comes from `remote`.
pub(super) fn receiver<T: Message, R: Remote>(
    executor: &Executor,
    name: &str,
    remote: R,
    style: Style,
) -> luna::Result<Receiver<T>> {
    let (local, receiver) = style.channel(name);
    let process = executor.process(format!("link from {name}"));
    let body = move || carry_in::<T, R>(remote, local, style);
    process.priority(LEVEL).spawn(body)?;
    Ok(receiver)
}

/// Ends when the unit's end is gone.
async fn carry_out<T: Message>(
    remote: impl Remote,
    local: Receiver<T>,
    style: Style,
) -> luna::Result<()> {
    // The value of a rendezvous whose sender waits. It outlives a session.
    let mut held: Option<Extended<'_, T>> = None;
    let is_over = loop {
        let (far, mut link) = open(&remote, |remote| remote.open_sender::<T>()).await?;
        let values = async {
            loop {
                let value = match (style, &held) {
                    (_, Some(value)) => **value,
                    (Style::Newest(_), None) => match local.recv().await {
                        Ok(value) => value,
                        Err(_) => return true,
                    },
                    (Style::Rendezvous, None) => match local.recv_extended().await {
                        Ok(value) => **held.insert(value),
                        Err(_) => return true,
                    },
                };
                if far.send(value).await.is_err() {
                    return false;
                }
                // Its sender goes on.
                held = None;
            }
        };
        let gives_up = async {
            local.ended().await;
            luna::after(GRACE).await;
            true
        };
        if future::or(values, future::or(ended(&mut link), gives_up)).await {
            break held.take();
        }
    };
    if let Some(value) = is_over {
        value.refuse(ChannelEnd::Closed);
    }
    Ok(())
}

/// Ends when the unit's end is gone.
async fn carry_in<T: Message, R: Remote>(
    remote: R,
    local: Sender<T>,
    style: Style,
) -> luna::Result<()> {
    loop {
        let (far, mut link) = open(&remote, |remote| remote.open_receiver::<T>()).await?;
        let values = async {
            // The other program goes on when the unit has taken the value.
            while let Ok(arrived) = far.recv_extended().await {
                if local.send(R::value(&arrived)).await.is_err() {
                    return true;
                }
            }
            false
        };
        let is_over = async {
            local.ended().await;
            true
        };
        if future::or(is_over, future::or(values, ended(&mut link))).await {
            return Ok(());
        }
        if let (Style::Newest(_), Some(lost)) = (style, T::lost())
            && local.send(lost).await.is_err()
        {
            return Ok(());
        }
    }
}

/// Opens a side of a channel. What holds it may be about to let go: this program's session before,
/// or the program that is killed.
async fn open<R: Remote, L: Send + 'static>(
    remote: &R,
    side: impl Fn(R) -> luna::Result<L> + Copy + Send + 'static,
) -> luna::Result<L> {
    let mut attempts = 0;
    loop {
        let remote = remote.clone();
        attempts += 1;
        match luna::blocking(move || side(remote)).await {
            Ok(opened) => return Ok(opened),
            Err(_) if attempts < ATTEMPTS => luna::after(PAUSE).await,
            Err(error) => return Err(error),
        }
    }
}

/// Runs a link to its end. Its error says that the other program has died, which the unit learns as
/// [`Message::lost`].
async fn ended(link: &mut impl Process) -> bool {
    let _ = link.run().await;
    false
}
