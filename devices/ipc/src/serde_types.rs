//! Values that are no plain data, by serde in postcard's format.

use crate::codec::Codec;
use crate::{ClientLink, Endpoint, IpcError, ReceiveLink, SendLink, ServerLink};
use luna::channel::{Client, Server};
use luna::{Buffer, Receiver, Sender};
use serde::Serialize;
use serde::de::DeserializeOwned;

impl Endpoint {
    /// As [`sender`](Self::sender), for a type of serde: strings, vectors, enums with fields. A
    /// value has at most `capacity` bytes in postcard's format; both programs state the same. The
    /// programs compare [`std::any::type_name`], so the type is defined in a crate that both use,
    /// and the capacity and the layout version.
    ///
    /// A value that does not fit goes back to its sender, the channel is poisoned in both programs,
    /// and the link ends with [`IpcError::Encode`]. If the other program cannot decode a value, the
    /// same happens with [`IpcError::Decode`] there.
    ///
    /// Real-time path: encoding allocates nothing, as far as the type's `Serialize` does not, and
    /// takes time as the value is large. Decoding allocates a copy of the encoded value, so that the
    /// other program cannot change what was checked, and what the type owns: for a loop that may not
    /// allocate, use plain data.
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    ///
    /// ```
    /// use luna_ipc::Endpoint;
    /// use serde::{Deserialize, Serialize};
    ///
    /// #[derive(Serialize, Deserialize)]
    /// struct Order {
    ///     part: String,
    ///     steps: Vec<u16>,
    /// }
    ///
    /// let name = format!("doc/{}/orders", std::process::id());
    /// let endpoint = Endpoint::new(&name);
    /// let (orders, link) = endpoint.serde_sender::<Order>(1024)?;
    /// # drop(orders);
    /// # Ok::<(), luna_ipc::IpcError>(())
    /// ```
    pub fn serde_sender<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        capacity: usize,
    ) -> Result<(Sender<T>, SendLink<T>), IpcError> {
        self.sending(Codec::postcard(capacity, self.version), luna::channel())
    }

    /// As [`receiver`](Self::receiver), for a type of serde: see
    /// [`serde_sender`](Self::serde_sender).
    ///
    /// # Errors
    ///
    /// As for [`receiver`](Self::receiver).
    ///
    /// ```
    /// let name = format!("doc/{}/texts", std::process::id());
    /// let endpoint = luna_ipc::Endpoint::new(&name);
    /// let (texts, link) = endpoint.serde_receiver::<String>(80)?;
    /// # drop(texts);
    /// # Ok::<(), luna_ipc::IpcError>(())
    /// ```
    pub fn serde_receiver<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        capacity: usize,
    ) -> Result<(Receiver<T>, ReceiveLink<T>), IpcError> {
        self.receiving(Codec::postcard(capacity, self.version))
    }

    /// As [`serde_sender`](Self::serde_sender), with a [buffer](Self::buffered_sender) in front of
    /// it.
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    ///
    /// ```
    /// let name = format!("doc/{}/lines", std::process::id());
    /// let endpoint = luna_ipc::Endpoint::new(&name);
    /// let (lines, link) = endpoint.buffered_serde_sender::<String>(80, luna::Buffer::fifo(16))?;
    /// lines.try_send("started".to_owned()).unwrap();
    /// # Ok::<(), luna_ipc::IpcError>(())
    /// ```
    pub fn buffered_serde_sender<T: Serialize + DeserializeOwned + Send + 'static>(
        &self,
        capacity: usize,
        buffer: Buffer,
    ) -> Result<(Sender<T>, SendLink<T>), IpcError> {
        let codec = Codec::postcard(capacity, self.version);
        self.sending(codec, luna::buffered(buffer))
    }

    /// As [`client`](Self::client), for types of serde: a request has at most `request` bytes, an
    /// answer at most `answer` bytes.
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    ///
    /// ```
    /// let name = format!("doc/{}/plan", std::process::id());
    /// let endpoint = luna_ipc::Endpoint::new(&name);
    /// let (plan, link) = endpoint.serde_client::<String, Vec<u16>>(80, 512)?;
    /// # drop(plan);
    /// # Ok::<(), luna_ipc::IpcError>(())
    /// ```
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn serde_client<Q, A>(
        &self,
        request: usize,
        answer: usize,
    ) -> Result<(Client<Q, A>, ClientLink<Q, A>), IpcError>
    where
        Q: Serialize + DeserializeOwned + Send + 'static,
        A: Serialize + DeserializeOwned + Send + 'static,
    {
        let version = self.version;
        self.calling(
            Codec::postcard(request, version),
            Codec::postcard(answer, version),
        )
    }

    /// As [`server`](Self::server), for types of serde: see [`serde_client`](Self::serde_client).
    ///
    /// # Errors
    ///
    /// As for [`sender`](Self::sender).
    #[expect(clippy::type_complexity, reason = "an end and its link, as for all")]
    pub fn serde_server<Q, A>(
        &self,
        request: usize,
        answer: usize,
    ) -> Result<(Server<Q, A>, ServerLink<Q, A>), IpcError>
    where
        Q: Serialize + DeserializeOwned + Send + 'static,
        A: Serialize + DeserializeOwned + Send + 'static,
    {
        let version = self.version;
        self.serving(
            Codec::postcard(request, version),
            Codec::postcard(answer, version),
        )
    }
}
