//! The process that keeps a connection up.

use super::traffic::Traffic;
use super::{Origin, Reconnect, TcpPort};
use crate::Counts;
use crate::end::Lose;
use crate::pump::OnBad;
use luna::devices::Device;
use luna::external::{Framing, FromBytes, LinkError, Packer, Splitter, ToBytes};
use luna::{Process, Receiver, Sender};
use std::future::Future;
use std::time::Duration;

/// Creates a process that sends values from `outgoing` over the connection, and received values to
/// `incoming`.
///
/// Records are sent completely and in order. A record in progress when a connection broke is sent
/// again over the next, from its beginning; records that only the kernel had may be lost. Records
/// received completely before a connection broke are still delivered; a record that was cut off is
/// counted as [bad](Counts::bad).
///
/// When the last sender to `outgoing` is gone and all is written, the connection is closed in that
/// direction, and the link ends when the other side closes it too. When the last receiver of
/// `incoming` is gone nothing is read any more, and the link ends when there is nothing more to
/// send. A peer that does not read blocks the senders, and memory does not grow; with a
/// [patience](Link::patience) such a connection is closed.
///
/// Real-time path: while connected, as [`reader`](crate::reader); connecting is off it, on a buddy
/// thread. Cancel-safe, as [`reader`](crate::reader) is.
///
/// # Errors
///
/// The framing is invalid.
pub fn link<O: ToBytes + Send, I: FromBytes + Send>(
    port: &Device<TcpPort>,
    outgoing: Receiver<O>,
    incoming: Sender<I>,
    framing: Framing,
) -> Result<Link<O, I>, LinkError> {
    Ok(Link {
        origin: Some(port.origin.clone()),
        device: Some(Box::new(port.clone())),
        outgoing: Some(outgoing.external()),
        incoming: Some(incoming.external()),
        splitter: Splitter::new(framing)?,
        packer: Packer::new(framing)?,
        reconnect: Reconnect::default(),
        patience: None,
        until_unread: false,
        on_bad: OnBad::default(),
        sent: Counts::default(),
        received: Counts::default(),
    })
}

/// A link over TCP, to be spawned: see [`link`].
#[must_use = "a link is a process: spawn it"]
pub struct Link<O, I> {
    origin: Option<Origin>,
    device: Option<Box<dyn Lose>>,
    outgoing: Option<Receiver<O>>,
    incoming: Option<Sender<I>>,
    splitter: Splitter,
    packer: Packer,
    reconnect: Reconnect,
    patience: Option<Duration>,
    until_unread: bool,
    on_bad: OnBad,
    sent: Counts,
    received: Counts,
}

impl<O, I> Link<O, I> {
    /// Sets when it connects again; default [`Reconnect::default`].
    pub fn reconnect(mut self, policy: Reconnect) -> Self {
        self.reconnect = policy;
        self
    }

    /// For how long nothing may get out before the connection is given up.
    pub fn patience(mut self, patience: Duration) -> Self {
        self.patience = Some(patience);
        self
    }

    /// Ends the link as soon as the last receiver of `incoming` is gone, connected or not. What is
    /// still to be sent is dropped. For a machine that is to end, whether the other side takes the
    /// last value or not.
    ///
    /// ```
    /// use luna::external::Framing;
    /// use luna::prelude::*;
    /// use luna_links::tcp;
    ///
    /// let mut system = System::new("robot");
    /// // No program listens there.
    /// let port = tcp::connect(&system.devices(), "127.0.0.1:9".parse().unwrap())?;
    /// let (position, positions) = luna::buffered::<[u8; 8]>(Buffer::overwrite_oldest(1));
    /// let (order, orders) = luna::channel::<[u8; 1]>();
    /// let link = tcp::link(&port, positions, order, Framing::chunks(8))?.until_unread();
    /// let main = system.executor("main").build()?;
    /// main.process("link").spawn(link)?;
    /// main.process("robot").spawn(async move {
    ///     position.send(0_f64.to_le_bytes()).await?;
    ///     drop(orders);
    ///     Ok(())
    /// })?;
    /// # match system.run() {
    /// #     Err(error) if error.to_string().contains("needs Linux") => return Ok(()),
    /// #     ran => ran,
    /// # }?;
    /// # #[cfg(any())]
    /// system.run()?; // ends, though the position was not sent
    /// # Ok::<(), luna::Error>(())
    /// ```
    pub fn until_unread(mut self) -> Self {
        self.until_unread = true;
        self
    }

    /// Sets what is done with broken records; by default they end the link.
    pub fn on_bad(mut self, policy: OnBad) -> Self {
        self.on_bad = policy;
        self
    }

    /// What it counts of the records that come, and the connections.
    pub fn received(&self) -> Counts {
        self.received.clone()
    }

    /// What it counts of the records that go.
    pub fn sent(&self) -> Counts {
        self.sent.clone()
    }
}

impl<O: ToBytes + Send, I: FromBytes + Send> Process for Link<O, I> {
    fn run(&mut self) -> impl Future<Output = luna::Result<()>> {
        let _ = luna::external::prepare_files();
        async {
            let (Some(outgoing), Some(incoming), Some(device), Some(origin)) = (
                self.outgoing.take(),
                self.incoming.take(),
                &self.device,
                &self.origin,
            ) else {
                return Err(LinkError::NotPrepared.into());
            };
            let mut traffic = Traffic {
                outgoing: Some(outgoing),
                incoming: Some(incoming),
                splitter: &mut self.splitter,
                packer: &mut self.packer,
                is_unsent: false,
                patience: self.patience,
                until_unread: self.until_unread,
                on_bad: self.on_bad,
                sent: &self.sent,
                received: &self.received,
            };
            let stop = traffic.keep_up(origin, self.reconnect).await;
            stop.end(&**device)
        }
    }

    /// Lets go of the device.
    fn post_run(&mut self) {
        self.origin = None;
        self.device = None;
    }
}

luna_platform::debug_fields!(
    impl[O, I] Link<O, I>, |link|
    origin: link.origin,
    reconnect: link.reconnect,
    sent: link.sent,
    received: link.received
);
