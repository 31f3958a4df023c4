//! Channels between programs on one computer.
//!
//! A channel has a name, one program that sends and one that receives. Each program opens its side
//! and gets LUNA's ordinary [`Sender`] or [`Receiver`], and a *link*: a process that carries the
//! values. The send goes on when a process of the other program has taken the value; if that
//! process receives by [`recv_extended`](Receiver::recv_extended), when it is done with the value.
//!
//! ```
//! use luna::prelude::*;
//!
//! # let name = format!("doc/{}/ready", std::process::id());
//! # let name = name.as_str();
//! // In the one program, with a name such as "cell/feeder/ready":
//! let (ready, link) = luna_ipc::sender::<u32>(name)?;
//! let mut system = System::new("feeder");
//! let main = system.executor("main").build()?;
//! main.process("link").spawn(link)?;
//! main.process("feeder").spawn(async move {
//!     ready.send(7).await?; // the other program has taken it
//!     Ok(())
//! })?;
//! // In the other one; here a thread plays it.
//! # let name = name.to_owned();
//! let door = std::thread::spawn(move || -> luna::Result<()> {
//!     let (ready, link) = luna_ipc::receiver::<u32>(&name)?;
//!     let mut system = System::new("door");
//!     let main = system.executor("main").build()?;
//!     main.process("link").spawn(link)?;
//!     main.process("door").spawn(async move {
//!         assert_eq!(ready.recv().await?, 7);
//!         assert!(ready.recv().await.is_err_and(|error| error.is_closed()));
//!         Ok(())
//!     })?;
//!     system.run().map(drop)
//! });
//! system.run()?;
//! door.join().unwrap()?;
//! # Ok::<(), luna::Error>(())
//! ```
//!
//! Tools [look](mod@look) at what there is, and send and receive values of types that they learn
//! when they run ([`any`]).
//!
//! There are [call channels](client) too, with the caller's priority inherited by the server, and
//! [blackboards](Blackboard): the latest value of each key, for any number of programs. Large
//! values are [lent](Endpoint::loan_sender).
//!
//! # Guards
//!
//! A receiver is an input guard of `alt!` and [`Alternative`](luna::Alternative) as any other: the
//! value is acknowledged only if its guard is chosen. A sender is an output guard with one
//! decision, that of its own program: the guard is chosen as soon as the other program has joined
//! and no other value is under way. The branch begins when the value was taken. It does not
//! choose by whether the other program's process waits at that instant. With a
//! [buffer](Endpoint::buffered_sender) it is chosen as in one program.
//!
//! # Limits
//!
//! - A value that the link has taken is under way, and is not withdrawn. A send with a deadline
//!   that passes then returns as sent, as with any extended rendezvous, without the other program's
//!   acknowledgement: [`Status::acknowledged`] has what was acknowledged. Before the other program
//!   has joined, no value is taken, and a deadline is exact.
//! - A value is copied into shared memory and out of it, but for a [`Loan`].
//! - Both programs have the same user, and see the same `/dev/shm` and the same process numbers:
//!   containers share both namespaces, or the opening fails.
//! - A program that forks without `exec` keeps its channels open in the child.
//! - The clock is the real one: on a virtual clock the link does not start.
//!
//! # The protocol
//!
//! A channel has four files in `/dev/shm`: a lock file, a segment of shared memory, and two FIFOs,
//! the *bells*, one for each side. Each is used only if it belongs to this user, lets no other one
//! in, and has one name: [`IpcError::Foreign`]. The segment is reserved, touched and, where the
//! system allows it, locked before a side is open: [`IpcError::Room`].
//!
//! **The lock file** has three bytes with locks of open file descriptions, which the kernel
//! releases when their program ends, however it ends. Byte 0 is the *set-up lock*: opening, binding
//! and closing hold it for a bounded number of system calls. A program waits for it for 5 s at most:
//! [`IpcError::Held`]. No real-time operation takes it. Bytes
//! 1 and 2 are the *roles*: a program holds byte 1 while it is the sender, byte 2 while it is the
//! receiver. So a role that is held belongs to a program that lives, and a second program for one
//! role is refused.
//!
//! **The words** of the segment, and the only writer of each:
//!
//! | word | writer | meaning |
//! | --- | --- | --- |
//! | type's name, size, alignment, version | the program that makes the segment, under the set-up lock | compared by each that joins |
//! | `start` | the program that binds, under the set-up lock | number of the last value of earlier sessions |
//! | `epoch` of a role | the holder of the role, under the set-up lock | openings of this role so far |
//! | `bound` of a role | its holder as it opens; the other side as it binds both; under the set-up lock | the other role's epoch in this session; 0: none yet |
//! | `pid`, `end` of a role | the holder of the role | its process; whether it has closed, poisoned or left the session |
//! | `asleep` of a role | its holder sets it, its partner clears it | the partner is to ring the bell |
//! | `thread` and its scheduling | a server's link | the thread to raise for a call; 0: it does not run, and no call is taken |
//! | `raised` | a client's link | whether it has raised that thread for the last call |
//! | `published`, value | the sender | number of the newest value, and the value |
//! | `taken` | the receiver | number of the last value that was taken |
//!
//! **Binding.** A session is one epoch of the sender with one epoch of the receiver. A program that
//! opens a role while the other role is held and not yet bound binds both: `start` = `published`,
//! then its own `bound`, then the other's. If the other is bound already, that is to a dead
//! session: the program stays unbound, rings, and the other side ends that session, opens again,
//! and binds. So no epoch is in two sessions. An opening always rings, so one that was killed
//! between binding and ringing leaves nobody asleep for longer than to the next opening.
//!
//! **A value.** The sender's link takes a value from a local process by an extended rendezvous,
//! writes it, stores `published` = n (release) and rings. The receiver's link sees `published` =
//! n (acquire), reads the value, sends it to a local process, stores `taken` = n when that process
//! has taken it, and rings. The sender's link sees `taken` = n and releases its process. Numbers
//! are never used twice, and there is one value under way at most.
//!
//! **A call** is a value with an answer: the receiver's link writes it, on pages of its own, before
//! it stores `taken`. The sender's link raises the other link's thread before it stores
//! `published`, and sets it back after it has seen `taken`.
//!
//! **Waking.** A link that has nothing to do sets `asleep`, looks once more, and waits for its bell
//! as for any file. Its partner changes a word, and then exchanges `asleep` with 0: if it was set,
//! it writes one byte to the bell. That is its only system call on behalf of the other side. All of
//! these are sequentially consistent, so one of the two sees the other's store. Nothing spins
//! without a bound: see [`Link::looks`].
//!
//! **Death.** A link waits for the end of its partner's process too (a *pidfd*, which the kernel
//! makes readable when all threads of that process have ended; so no store comes after it). That
//! the number in `pid` still is the partner's is checked by the role's lock and epoch, after the
//! pidfd was opened. The dead can hold nothing that the other side waits for:
//!
//! | killed | seen by the other side |
//! | --- | --- |
//! | while opening, under the set-up lock | the lock is free. If neither role is held, the next opening removes all and begins anew; else the epoch counts as dead |
//! | after binding, before ringing | bound to a process that is dead: found at the next opening of that role |
//! | sender, before `published` = n | nothing of the value |
//! | sender, after `published` = n | the value may still be taken; then the session ends. A value that is offered and not yet taken is withdrawn |
//! | receiver, before `taken` = n | the send fails, and gives the value back. It may have been taken: only the receiver could say |
//! | receiver, after `taken` = n | the send is done |
//! | either, after its store, before it rings | the pidfd wakes the other side, which looks at the words once more |
//!
//! So a send that has returned `Ok` without a deadline was taken once. A failed one was taken once
//! or not at all. Values of earlier sessions are never delivered, since a session begins at
//! `start`, so none is seen twice. [`Status::missing`] counts those without acknowledgement.
//!
//! **After it.** The link poisons the local channel: its operations then fail with
//! [`Error::Poisoned`](luna::Error::Poisoned). The link ends with [`IpcError::PartnerDied`]. The
//! program opens the channel again: that is the next session. The last side to close removes the
//! files. If both were killed, the files stay until the next opening of the channel, or
//! [`clean_up`].

#![cfg(target_os = "linux")]
#![cfg_attr(
    not(test),
    warn(
        clippy::unwrap_used,
        clippy::expect_used,
        clippy::arithmetic_side_effects
    )
)]

pub mod any;
mod blackboard;
mod call;
mod codec;
mod copy;
mod error;
mod files;
mod free;
mod inherit;
mod link;
mod loan;
pub mod look;
mod memory;
mod name;
mod owned;
mod receive_link;
mod segment;
mod send_link;
#[cfg(feature = "serde")]
mod serde_types;
mod session;
mod status;
mod wait;

pub use blackboard::{
    Blackboard, BoardReader, BoardWriter, Contended, ReadEntry, Reading, WriteEntry, WriterState,
};
pub use call::{ClientLink, ServerLink};
pub use error::{IpcError, Role, TypeInfo};
pub use files::clean_up;
/// Derives [`trait@ZeroCopySend`] for a `#[repr(C)]` type of plain data. `#[type_name("Block")]`
/// states a name that does not depend on the crate that defines it.
pub use iceoryx2_bb_derive_macros::ZeroCopySend;
/// iceoryx2's mark of plain data: no pointers, the same layout in all programs. Derive it.
pub use iceoryx2_bb_elementary_traits::zero_copy_send::ZeroCopySend;
pub use link::Link;
pub use loan::{Lent, Loan, Loans};
pub use receive_link::ReceiveLink;
pub use send_link::SendLink;
pub use status::Status;

use codec::{Codec, Place};
use luna::channel::{Client, Server};
use luna::{Buffer, Receiver, Sender};
use name::Name;
use receive_link::{Deliveries, Inward};
use send_link::{Outward, Values};
use session::Session;

/// Opens the sending side of the channel `name`: [`Endpoint::sender`] with layout version 0.
///
/// # Errors
///
/// As there.
///
/// ```
/// let name = format!("doc/{}/sender", std::process::id());
/// let (sender, link) = luna_ipc::sender::<u32>(&name)?;
/// assert!(luna_ipc::sender::<u32>(&name).is_err()); // there is one
/// # drop((sender, link));
/// # Ok::<(), luna_ipc::IpcError>(())
/// ```
pub fn sender<T: ZeroCopySend + Send + 'static>(
    name: &str,
) -> Result<(Sender<T>, SendLink<T>), IpcError> {
    Endpoint::new(name).sender()
}

/// Opens the receiving side of the channel `name`: [`Endpoint::receiver`] with layout version 0.
///
/// # Errors
///
/// As there.
///
/// ```
/// let name = format!("doc/{}/receiver", std::process::id());
/// let (receiver, link) = luna_ipc::receiver::<[f32; 4]>(&name)?;
/// assert!(!link.status().has_joined());
/// # drop(receiver);
/// # Ok::<(), luna_ipc::IpcError>(())
/// ```
pub fn receiver<T: ZeroCopySend + Send + 'static>(
    name: &str,
) -> Result<(Receiver<T>, ReceiveLink<T>), IpcError> {
    Endpoint::new(name).receiver()
}

/// Opens the calling side of the call channel `name`: [`Endpoint::client`] with layout version 0.
///
/// # Errors
///
/// As there.
///
/// ```
/// let name = format!("doc/{}/client", std::process::id());
/// let (client, link) = luna_ipc::client::<u32, f64>(&name)?;
/// # drop((client, link));
/// # Ok::<(), luna_ipc::IpcError>(())
/// ```
#[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
pub fn client<Q, A>(name: &str) -> Result<(Client<Q, A>, ClientLink<Q, A>), IpcError>
where
    Q: ZeroCopySend + Send + 'static,
    A: ZeroCopySend + Send + 'static,
{
    Endpoint::new(name).client()
}

/// Opens the serving side of the call channel `name`: [`Endpoint::server`] with layout version 0.
///
/// # Errors
///
/// As there.
///
/// ```
/// let name = format!("doc/{}/server", std::process::id());
/// let (server, link) = luna_ipc::server::<u32, f64>(&name)?;
/// # drop((server, link));
/// # Ok::<(), luna_ipc::IpcError>(())
/// ```
#[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
pub fn server<Q, A>(name: &str) -> Result<(Server<Q, A>, ServerLink<Q, A>), IpcError>
where
    Q: ZeroCopySend + Send + 'static,
    A: ZeroCopySend + Send + 'static,
{
    Endpoint::new(name).server()
}

/// How a side of a channel is opened.
///
/// ```
/// let name = format!("doc/{}/endpoint", std::process::id());
/// let endpoint = luna_ipc::Endpoint::new(&name).layout_version(2);
/// let (sender, link) = endpoint.sender::<u64>()?;
/// drop(link);
/// drop(sender);
/// # Ok::<(), luna_ipc::IpcError>(())
/// ```
#[derive(Debug, Clone)]
pub struct Endpoint {
    name: String,
    version: u32,
}

impl Endpoint {
    /// Of the channel with this name: 1 to 180 letters, digits, `_`, `-`, `.` and `/`.
    pub fn new(name: &str) -> Self {
        Self {
            name: name.to_owned(),
            version: 0,
        }
    }

    /// The version of the value's layout, which both programs have to agree on; 0 if not stated.
    /// Count it up when the fields of the type get another meaning in the same size.
    #[must_use]
    pub fn layout_version(mut self, version: u32) -> Self {
        self.version = version;
        self
    }

    /// Opens the sending side. The other program may open its side earlier or later.
    ///
    /// All memory that the channel uses is taken here, and locked as far as the system allows
    /// ([`Status::is_locked`]).
    ///
    /// Not for the real-time path: it makes files, maps memory and may wait for another program
    /// that opens or closes the same channel, for 5 s at most. While the system runs, call it in
    /// [`luna::blocking`].
    ///
    /// # Errors
    ///
    /// [`IpcError`]: a name that cannot be used, another program that holds the role, another type
    /// on the other side, files of another user, no room for the shared memory, or the system's
    /// error. Nothing is left behind.
    pub fn sender<T: ZeroCopySend + Send + 'static>(
        &self,
    ) -> Result<(Sender<T>, SendLink<T>), IpcError> {
        self.sending(Codec::plain(self.version), luna::channel())
    }

    /// Opens the sending side with a buffer in front of it, in this program: FIFO or overwriting. A
    /// send goes on when its value is in the buffer, so an output guard is chosen exactly as in one
    /// program. The link takes the next value when the other program has taken the one before.
    /// [`Status::acknowledged`] counts those that have arrived.
    ///
    /// When the last sender is gone, the link first delivers what is in the buffer, and waits for
    /// the other program for that. Poison, and the other program's end, drop what is in the buffer
    /// and the value under way. All else is as for [`sender`](Self::sender).
    ///
    /// # Errors
    ///
    /// As there.
    ///
    /// ```
    /// use luna::Buffer;
    ///
    /// let name = format!("doc/{}/buffered", std::process::id());
    /// let endpoint = luna_ipc::Endpoint::new(&name);
    /// // The other program gets the newest value whenever it looks.
    /// let (setpoint, link) = endpoint.buffered_sender::<f64>(Buffer::overwrite_oldest(1))?;
    /// setpoint.try_send(1.0).unwrap();
    /// setpoint.try_send(2.0).unwrap();
    /// # drop(link);
    /// # Ok::<(), luna_ipc::IpcError>(())
    /// ```
    pub fn buffered_sender<T: ZeroCopySend + Send + 'static>(
        &self,
        buffer: Buffer,
    ) -> Result<(Sender<T>, SendLink<T>), IpcError> {
        self.sending(Codec::plain(self.version), luna::buffered(buffer))
    }

    /// Opens the receiving side. All else is as for [`sender`](Self::sender).
    ///
    /// # Errors
    ///
    /// As there.
    pub fn receiver<T: ZeroCopySend + Send + 'static>(
        &self,
    ) -> Result<(Receiver<T>, ReceiveLink<T>), IpcError> {
        self.receiving(Codec::plain(self.version))
    }

    fn sending<T: Send>(
        &self,
        codec: Codec<T>,
        (sender, receiver): (Sender<T>, Receiver<T>),
    ) -> Result<(Sender<T>, SendLink<T>), IpcError> {
        let place = Place::first(codec);
        let session = self.open(Role::Sender, place.info().clone(), place.end())?;
        let near = Outward(Values::new(receiver, place));
        Ok((sender.named(&self.name), Link::new(session, near)))
    }

    fn receiving<T: Send>(
        &self,
        codec: Codec<T>,
    ) -> Result<(Receiver<T>, ReceiveLink<T>), IpcError> {
        let place = Place::first(codec);
        let session = self.open(Role::Receiver, place.info().clone(), place.end())?;
        let (sender, receiver) = luna::channel();
        let near = Inward(Deliveries::new(sender, place));
        Ok((receiver.named(&self.name), Link::new(session, near)))
    }

    /// `size`: of the segment, if there are addresses for it.
    fn open(&self, role: Role, info: TypeInfo, size: Option<usize>) -> Result<Session, IpcError> {
        let name = Name::new(&self.name)?;
        match size {
            Some(size) => Session::open(name, role, info, size),
            None => Err(IpcError::Size {
                name: self.name.clone(),
                value: Box::new(info),
            }),
        }
    }
}
