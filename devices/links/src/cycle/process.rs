//! A link with channels on its near side.

use super::data::CycleData;
use super::error::CycleError;
use super::link::{CycleLink, Taken};
use super::sample::{Sample, Silence};
use super::status::Status;
use luna::external::LinkError;
use luna::{Process, Receiver, Sender};
use luna_platform::clock::Clock;

/// How many values are delivered before one is sent, if there are both.
const IN_ONE_GO: u32 = 16;

/// What a [`CycleProcess`] delivers.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading<T> {
    /// A value.
    Fresh(Sample<T>),
    /// The partner is silent. Only with [`OnStale::Report`], and once for each silence.
    Stale(Silence),
}

/// What a [`CycleProcess`] does about a silent partner. It is [counted](Status::stale) either way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum OnStale {
    /// It ends with [`CycleError::Stale`], and poisons both its channels. Before the first value it
    /// waits: the partner may be started later.
    #[default]
    End,
    /// It delivers [`Reading::Stale`], and goes on.
    Report,
}

impl<O: CycleData, I: CycleData> CycleLink<O, I> {
    /// A process that sends each value of `outgoing` in a datagram, and delivers what comes to
    /// `incoming`.
    ///
    /// Give both channels a buffer that overwrites
    /// ([`Buffer::overwrite_oldest`](luna::Buffer::overwrite_oldest)), so that the newest value is
    /// sent, and a receiver that is slow delays no sending. It ends without an error when the last
    /// sender of the one, or the last receiver of the other, is gone.
    ///
    /// Cancel-safe: a value that was taken and not delivered is lost. Real-time path: from its `run`
    /// on.
    ///
    /// ```
    /// use luna::prelude::*;
    /// use luna_links::cycle::{CycleLink, Reading, Settings};
    /// use std::net::UdpSocket;
    /// use std::time::Duration;
    ///
    /// // Another program; here both are in one.
    /// let sockets = [UdpSocket::bind("127.0.0.1:0")?, UdpSocket::bind("127.0.0.1:0")?];
    /// let addresses = [sockets[0].local_addr()?, sockets[1].local_addr()?];
    /// let settings = Settings::new(Duration::from_secs(2)); // a busy machine's
    /// let mut system = System::new("two arms");
    /// let main = system.executor("main").build()?;
    /// for (number, socket) in sockets.into_iter().enumerate() {
    ///     let link = CycleLink::<[u8; 8], [u8; 8]>::over(socket, addresses[1 - number], &settings)
    ///         .map_err(luna::Error::other)?;
    ///     let (values, outgoing) = luna::buffered(Buffer::overwrite_oldest(1));
    ///     let (incoming, readings) = luna::buffered(Buffer::overwrite_oldest(1));
    ///     main.process(format!("link {number}")).spawn(link.process(outgoing, incoming))?;
    ///     main.process(format!("arm {number}")).spawn(async move {
    ///         let mut tick = luna::periodic(format!("arm {number}"), Duration::from_millis(1))?;
    ///         let mut fresh = 0;
    ///         while fresh < 3 {
    ///             tick.next().await;
    ///             values.send([number as u8; 8]).await?;
    ///             if let Ok(Reading::Fresh(sample)) = readings.try_recv() {
    ///                 assert_eq!(sample.value, [1 - number as u8; 8]);
    ///                 fresh += 1;
    ///             }
    ///         }
    ///         // The other one may need more.
    ///         for _ in 0..50 {
    ///             tick.next().await;
    ///             if values.send([number as u8; 8]).await.is_err() {
    ///                 break;
    ///             }
    ///         }
    ///         Ok(())
    ///     })?;
    /// }
    /// # if !cfg!(luna_portable) {
    /// system.run()?;
    /// # }
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn process(
        self,
        outgoing: Receiver<O>,
        incoming: Sender<Reading<I>>,
    ) -> CycleProcess<O, I> {
        CycleProcess {
            status: self.status(),
            link: Some(self),
            outgoing: Some(outgoing.external()),
            incoming: Some(incoming.external()),
            on_stale: OnStale::default(),
        }
    }
}

/// Made by [`CycleLink::process`]: a process to be spawned.
#[must_use = "a link is a process: spawn it"]
pub struct CycleProcess<O, I> {
    link: Option<CycleLink<O, I>>,
    outgoing: Option<Receiver<O>>,
    incoming: Option<Sender<Reading<I>>>,
    on_stale: OnStale,
    status: Status,
}

impl<O, I> CycleProcess<O, I> {
    /// What it does about a silent partner.
    pub fn on_stale(mut self, policy: OnStale) -> Self {
        self.on_stale = policy;
        self
    }

    /// What it counts.
    pub fn status(&self) -> Status {
        self.status.clone()
    }
}

impl<O: CycleData, I: CycleData> Process for CycleProcess<O, I> {
    /// # Errors
    ///
    /// The system runs on a virtual clock.
    fn pre_run(&mut self) -> luna::Result<()> {
        match &self.link {
            Some(link) if Clock::is_virtual_here() => {
                Err(CycleError::VirtualClock { peer: link.peer() }.into())
            }
            _ => Ok(()),
        }
    }

    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        // Here, off the real-time path. If it fails, the first wait fails too, and reports it.
        let _ = luna::external::prepare_files();
        async {
            let (outgoing, incoming) = (self.outgoing.take(), self.incoming.take());
            let (Some(link), Some(outgoing), Some(incoming)) = (&mut self.link, outgoing, incoming)
            else {
                return Err(LinkError::NotPrepared.into());
            };
            match carry(link, &outgoing, &incoming, self.on_stale).await {
                Err(luna::Error::Closed) => Ok(()),
                Err(error) => {
                    outgoing.poison();
                    incoming.poison();
                    Err(error)
                }
                Ok(()) => Ok(()),
            }
        }
    }

    /// Closes the socket.
    fn post_run(&mut self) {
        self.link = None;
    }
}

/// Until an error.
async fn carry<O: CycleData, I: CycleData>(
    link: &mut CycleLink<O, I>,
    outgoing: &Receiver<O>,
    incoming: &Sender<Reading<I>>,
    on_stale: OnStale,
) -> luna::Result<()> {
    let mut is_stale = false;
    loop {
        for _ in 0..IN_ONE_GO {
            let now = link.begin()?;
            match link.take(now)? {
                Taken::Sample(sample) => {
                    is_stale = false;
                    incoming.send(Reading::Fresh(sample)).await?;
                }
                Taken::Other => {}
                Taken::Empty => break,
            }
        }
        if !is_stale && let Err(error) = link.unless_stale() {
            let CycleError::Stale { silence, .. } = error else {
                return Err(error.into());
            };
            match on_stale {
                OnStale::End if silence.has_heard => return Err(error.into()),
                // The partner may be started later.
                OnStale::End => {}
                OnStale::Report => incoming.send(Reading::Stale(silence)).await?,
            }
            is_stale = true;
        }
        let deadline = match is_stale {
            true => luna::Instant::NEVER,
            // Just behind it: at the deadline itself the partner is not late yet.
            false => link.protocol.deadline().plus_nanos(1),
        };
        let mut waited = Ok(());
        let event = async { waited = link.readable(deadline).await };
        match outgoing.recv_unless(event).await {
            Ok(value) => drop(link.send(&value)?),
            Err(error) if error.is_timeout() => waited?,
            Err(error) => return Err(error.into()),
        }
    }
}

luna_platform::debug_fields!(
    impl[O, I] CycleProcess<O, I>, |process|
    link: process.link,
    on_stale: process.on_stale,
    status: process.status
);
