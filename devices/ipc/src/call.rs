//! Calls between programs: a request and its reply are one value of the protocol.

use crate::codec::{Codec, Place};
use crate::error::TypeInfo;
use crate::inherit::{Raised, Servant};
use crate::link::{Bound, Link};
use crate::receive_link::{Drain, Inward};
use crate::send_link::{Outward, Source, end_of};
use crate::session::Session;
use crate::{Endpoint, IpcError, Role, ZeroCopySend};
use luna::channel::{Call, CallError, ChannelEnd, Client, RecvError, Server, call_channel};

/// The link of the calling side, made by [`client`](crate::client).
pub type ClientLink<Q, A> = Link<Outward<Calls<Q, A>>>;

/// The link of the serving side, made by [`server`](crate::server).
pub type ServerLink<Q, A> = Link<Inward<Served<Q, A>>>;

/// Where request and answer are.
struct Places<Q, A> {
    request: Place<Q>,
    answer: Place<Option<A>>,
}

impl<Q, A: 'static> Places<Q, A> {
    fn new(request: Codec<Q>, answer: Codec<A>) -> Self {
        let request = Place::first(request);
        let answer = Place::after(&request, Codec::optional(answer));
        Self { request, answer }
    }

    fn info(&self) -> TypeInfo {
        self.request.info().call(self.answer.info())
    }
}

/// From a call channel.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Calls<Q, A> {
    server: Server<Q, A>,
    places: Places<Q, A>,
}

/// A call that the link has accepted.
pub(crate) struct Accepted<'a, Q, A> {
    // Dropped first: its client goes on before the other program's thread is set back.
    call: Call<'a, Q, A>,
    raised: Option<Raised>,
}

impl<Q: Send, A: Send> Source for Calls<Q, A> {
    type Taken<'a>
        = Accepted<'a, Q, A>
    where
        Q: 'a,
        A: 'a;

    async fn take(&self) -> Result<Accepted<'_, Q, A>, RecvError> {
        let call = self.server.accept().await?;
        Ok(Accepted { call, raised: None })
    }

    async fn ended(&self) -> ChannelEnd {
        self.server.ended().await
    }

    async fn poisoned(&self) -> ChannelEnd {
        self.server.poisoned().await
    }

    fn has_more(&self) -> bool {
        false
    }

    fn poison(&self) {
        self.server.poison();
    }

    fn is_ready(session: &Session) -> bool {
        Servant::is_there(session)
    }

    unsafe fn write(
        &self,
        bound: &Bound<'_, '_>,
        taken: &mut Accepted<'_, Q, A>,
    ) -> Result<(), IpcError> {
        // SAFETY: the caller promises that this is the client, and that no call is under way: so
        // the server accesses nothing at the place of the request, and no other client is there.
        unsafe { self.places.request.write(bound.session, &taken.call) }?;
        taken.raised = Raised::to_caller(bound.session, bound.status);
        Ok(())
    }

    unsafe fn acknowledge(
        &self,
        session: &Session,
        taken: Accepted<'_, Q, A>,
    ) -> Result<(), IpcError> {
        // SAFETY: the caller promises that the server has taken the request. Before that it has
        // written its answer, with the codec of the type that both state; it writes the next one
        // only after the next request.
        if let Some(answer) = unsafe { self.places.answer.read(session) }? {
            // Its client may have gone.
            let _ = taken.call.reply(answer);
        }
        Ok(())
    }

    fn refuse(&self, taken: Accepted<'_, Q, A>, _: ChannelEnd) {
        // The server may have had the request, so it is not given back.
        drop(taken);
    }
}

/// To a call channel.
#[expect(missing_debug_implementations, reason = "only links hold it")]
pub struct Served<Q, A> {
    client: Client<Q, A>,
    places: Places<Q, A>,
}

impl<Q: Send, A: Send> Drain for Served<Q, A> {
    type Value = Q;
    type Answer = Option<A>;

    async fn ended(&self) -> ChannelEnd {
        self.client.ended().await
    }

    fn poison(&self) {
        self.client.poison();
    }

    unsafe fn read(&self, session: &Session) -> Result<Q, IpcError> {
        // SAFETY: the caller promises that this is the server, and that a request is under way: the
        // client has written it whole, with the codec of the type that both state, and does not
        // write again before it is taken.
        unsafe { self.places.request.read(session) }
    }

    async fn deliver(&self, request: Q) -> Result<Option<A>, ChannelEnd> {
        match self.client.call(request).await {
            Ok(answer) => Ok(Some(answer)),
            Err(CallError::Unanswered) => Ok(None),
            Err(error) => Err(end_of(error.is_closed())),
        }
    }

    unsafe fn answer(&self, session: &Session, answer: Option<A>) -> Result<(), IpcError> {
        // SAFETY: the caller promises that this is the server, and that a request is under way: the
        // client reads the answer only after the request is taken, so no one else accesses its
        // place.
        unsafe { self.places.answer.write(session, &answer) }
    }

    fn joined(&self, session: &Session) -> impl Sized {
        Servant::here(session)
    }

    fn answered(&self, session: &Session) {
        Servant::yield_to_caller(session);
    }
}

impl Endpoint {
    /// Opens the calling side of a call channel: plain data there and back. The other program opens
    /// [`server`](Self::server), earlier or later. In errors a client has the role of a sender.
    ///
    /// One call is under way at a time: the local clients wait for the link, the most urgent first.
    /// A call is over with the reply, as in one program. It fails as
    /// [`Unanswered`](CallError::Unanswered) if the server drops it without a reply, or if its
    /// program ends or closes after the link has taken the request: it may have been served.
    ///
    /// The server's thread inherits the caller's OS priority, from before it sees the request until
    /// the caller has the answer: the crate's documentation says how.
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    ///
    /// ```
    /// use luna::prelude::*;
    ///
    /// let name = format!("doc/{}/square", std::process::id());
    /// let (square, link) = luna_ipc::client::<u32, u64>(&name)?;
    /// // In the other program; here a thread plays it.
    /// let other = std::thread::spawn(move || -> luna::Result<()> {
    ///     let (square, link) = luna_ipc::server::<u32, u64>(&name)?;
    ///     let mut system = System::new("squares");
    ///     let main = system.executor("main").build()?;
    ///     main.process("link").priority(31).spawn(link)?;
    ///     main.process("square").spawn(async move {
    ///         while let Ok(call) = square.accept().await {
    ///             let answer = u64::from(*call) * u64::from(*call);
    ///             let _ = call.reply(answer); // the client may have gone
    ///         }
    ///         Ok(())
    ///     })?;
    ///     system.run().map(drop)
    /// });
    /// let mut system = System::new("asks");
    /// let main = system.executor("main").build()?;
    /// main.process("link").spawn(link)?;
    /// main.process("asks").spawn(async move {
    ///     assert_eq!(square.call(12).await, Ok(144));
    ///     Ok(())
    /// })?;
    /// system.run()?;
    /// other.join().unwrap()?;
    /// # Ok::<(), luna::Error>(())
    /// ```
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn client<Q, A>(&self) -> Result<(Client<Q, A>, ClientLink<Q, A>), IpcError>
    where
        Q: ZeroCopySend + Send + 'static,
        A: ZeroCopySend + Send + 'static,
    {
        self.calling(Codec::plain(self.version), Codec::plain(self.version))
    }

    /// Opens the serving side of a call channel: see [`client`](Self::client). In errors a server
    /// has the role of a receiver.
    ///
    /// Spawn the link on the executor of the processes that accept, at a level above theirs: the
    /// other program raises the thread on which the link runs.
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn server<Q, A>(&self) -> Result<(Server<Q, A>, ServerLink<Q, A>), IpcError>
    where
        Q: ZeroCopySend + Send + 'static,
        A: ZeroCopySend + Send + 'static,
    {
        self.serving(Codec::plain(self.version), Codec::plain(self.version))
    }

    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub(crate) fn calling<Q: Send, A: Send + 'static>(
        &self,
        request: Codec<Q>,
        answer: Codec<A>,
    ) -> Result<(Client<Q, A>, ClientLink<Q, A>), IpcError> {
        let places = Places::new(request, answer);
        let session = self.open(Role::Sender, places.info(), places.answer.end())?;
        let (client, server) = call_channel();
        let server = server.external();
        let near = Outward(Calls { server, places });
        Ok((client.named(&self.name), Link::new(session, near)))
    }

    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub(crate) fn serving<Q: Send, A: Send + 'static>(
        &self,
        request: Codec<Q>,
        answer: Codec<A>,
    ) -> Result<(Server<Q, A>, ServerLink<Q, A>), IpcError> {
        let places = Places::new(request, answer);
        let session = self.open(Role::Receiver, places.info(), places.answer.end())?;
        let (client, server) = call_channel();
        let client = client.external();
        let near = Inward(Served { client, places });
        Ok((server.named(&self.name), Link::new(session, near)))
    }
}
