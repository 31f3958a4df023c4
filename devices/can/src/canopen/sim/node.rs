//! The process that a simulated node is.

use super::dictionary::{Access, Dictionary, PDOS, Pdo};
use super::server::Transfer;
use crate::canopen::nmt::frame;
use crate::canopen::{Emergency, Heartbeat, NmtCommand, NmtState, NodeId, Object, SYNC, Value};
use crate::{Frame, Incoming, Port, PortError};
use luna::devices::Device;
use luna::{Buffer, Error, Instant, Process, Receiver, Sender};
use std::future::{Future, poll_fn};
use std::pin::pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::Poll;
use std::time::Duration;

const HEARTBEAT_TIME: Object = Object::new(0x1017, 0);
const ERROR_REGISTER: Object = Object::new(0x1001, 0);

/// A simulated node, to be spawned. It uses its device directly, without a controller.
///
/// It ends when all its [`NodeControl`]s are gone. Off the real-time path: it allocates.
#[must_use = "a node is a process: spawn it"]
pub struct Node<P: Port> {
    device: Option<Device<P>>,
    id: NodeId,
    shared: Arc<Mutex<Shared>>,
    /// After a reset.
    initial: Dictionary,
    commands: Option<Receiver<Command>>,
    control: Sender<Command>,
    transfer: Transfer,
    /// Since its last synchronous transmission, for each PDO.
    syncs: [u8; PDOS as usize],
    next_beat: Option<(Duration, Instant)>,
}

struct Shared {
    state: NmtState,
    dictionary: Dictionary,
}

enum Command {
    Changed(Object),
    Send(Frame),
}

/// Sees and changes a simulated node from outside, as its hardware does. Cloning is cheap.
#[derive(Clone)]
pub struct NodeControl {
    id: NodeId,
    shared: Arc<Mutex<Shared>>,
    commands: Sender<Command>,
}

fn lock(shared: &Mutex<Shared>) -> MutexGuard<'_, Shared> {
    shared.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<P: Port> Node<P> {
    /// A node with the objects that each has.
    pub fn new(device: &Device<P>, id: NodeId) -> Self {
        let dictionary = Dictionary::new(id);
        let (control, commands) = luna::buffered(Buffer::fifo(64));
        Self {
            device: Some(device.clone()),
            id,
            initial: dictionary.clone(),
            shared: Arc::new(Mutex::new(Shared {
                state: NmtState::BootUp,
                dictionary,
            })),
            commands: Some(commands),
            control,
            transfer: Transfer::None,
            syncs: [0; PDOS as usize],
            next_beat: None,
        }
    }

    /// Adds an object, or sets the value that it begins with.
    pub fn object<T: Value>(mut self, object: Object, value: T, access: Access) -> Self {
        let mut bytes = vec![0; T::LEN];
        value.encode(&mut bytes);
        self.initial.put(object, &bytes, access);
        lock(&self.shared).dictionary = self.initial.clone();
        self
    }

    /// Adds an object of any length: a text, say.
    pub fn bytes(mut self, object: Object, bytes: &[u8], access: Access) -> Self {
        self.initial.put_variable(object, bytes, access);
        lock(&self.shared).dictionary = self.initial.clone();
        self
    }

    /// Sends a heartbeat with this period from the start on, in milliseconds; 0 sends none.
    pub fn heartbeat(self, milliseconds: u16) -> Self {
        self.object(HEARTBEAT_TIME, milliseconds, Access::ReadWrite)
    }

    /// A handle to it. The node ends when all are gone: keep one for as long as it is to live.
    pub fn control(&self) -> NodeControl {
        NodeControl {
            id: self.id,
            shared: self.shared.clone(),
            commands: self.control.clone(),
        }
    }
}

impl NodeControl {
    /// The state that it is in.
    pub fn state(&self) -> NmtState {
        lock(&self.shared).state
    }

    /// The value of an object; none if there is none, or it has another length.
    pub fn get<T: Value>(&self, object: Object) -> Option<T> {
        T::decode(&self.bytes(object)?)
    }

    /// The bytes of an object.
    pub fn bytes(&self, object: Object) -> Option<Vec<u8>> {
        Some(lock(&self.shared).dictionary.get(object)?.to_vec())
    }

    /// Sets the value of an object, whatever its access, and lets the node send the PDOs of type
    /// 254 and 255 that have it. False if there is none with this length.
    ///
    /// # Errors
    ///
    /// The node has ended.
    pub async fn set<T: Value>(&self, object: Object, value: T) -> luna::Result<bool> {
        let mut bytes = vec![0; T::LEN];
        value.encode(&mut bytes);
        if !lock(&self.shared).dictionary.set(object, &bytes) {
            return Ok(false);
        }
        self.commands.send(Command::Changed(object)).await?;
        Ok(true)
    }

    /// Lets the node send an EMCY message, and sets its error register.
    ///
    /// # Errors
    ///
    /// The node has ended.
    pub async fn emergency(&self, code: u16, register: u8, data: [u8; 5]) -> luna::Result<()> {
        lock(&self.shared)
            .dictionary
            .set(ERROR_REGISTER, &[register]);
        let message = Emergency {
            node: self.id,
            code,
            register,
            data,
        };
        self.commands.send(Command::Send(message.frame())).await?;
        Ok(())
    }
}

/// What lets a node do something.
enum Wake {
    Came(Incoming),
    Commanded(Command),
    Beat,
    Ended,
}

impl<P: Port> Process for Node<P> {
    async fn run(&mut self) -> luna::Result<()> {
        let (Some(device), Some(commands)) = (self.device.clone(), self.commands.take()) else {
            return Err(luna::external::LinkError::NotPrepared.into());
        };
        // It is to end with the last handle of others.
        self.control = luna::channel().0;
        match self.go_on(&*device, &commands).await {
            Ok(()) | Err(PortError::Gone) => Ok(()),
            Err(error) => Err(device.lost(Error::other(error))),
        }
    }

    fn post_run(&mut self) {
        self.device = None;
    }
}

impl<P: Port> Node<P> {
    async fn go_on(&mut self, port: &P, commands: &Receiver<Command>) -> Result<(), PortError> {
        port.listen(&[crate::Filter::ANY])?;
        self.boot(port).await?;
        loop {
            self.set_beat();
            let due = self.next_beat.map(|(_, due)| due);
            let frames = match wait(port, commands, due).await? {
                Wake::Came(Incoming::Frame(frame)) => {
                    if let Some((command, to)) = NmtCommand::decode(&frame) {
                        if to.is_none_or(|to| to == self.id) {
                            self.obey(command, port).await?;
                        }
                        continue;
                    }
                    self.handle(&frame)
                }
                Wake::Came(Incoming::Report(_)) => Vec::new(),
                Wake::Commanded(Command::Send(frame)) => match self.state() {
                    NmtState::Stopped => Vec::new(),
                    _ => vec![frame],
                },
                Wake::Commanded(Command::Changed(object)) => self.changed(object),
                Wake::Beat => vec![self.beat()],
                Wake::Ended => return Ok(()),
            };
            for frame in frames {
                port.transmit(frame).await?;
            }
        }
    }

    fn state(&self) -> NmtState {
        lock(&self.shared).state
    }

    /// Begins anew, and says so.
    async fn boot(&mut self, port: &P) -> Result<(), PortError> {
        self.transfer = Transfer::None;
        let (node, state) = (self.id, NmtState::BootUp);
        port.transmit(Heartbeat { node, state }.frame()).await?;
        lock(&self.shared).state = NmtState::PreOperational;
        self.next_beat = None;
        Ok(())
    }

    async fn obey(&mut self, command: NmtCommand, port: &P) -> Result<(), PortError> {
        lock(&self.shared).state = match command {
            NmtCommand::Start => NmtState::Operational,
            NmtCommand::Stop => NmtState::Stopped,
            NmtCommand::EnterPreOperational => NmtState::PreOperational,
            NmtCommand::ResetNode => {
                lock(&self.shared).dictionary = self.initial.clone();
                return self.boot(port).await;
            }
            NmtCommand::ResetCommunication => {
                lock(&self.shared)
                    .dictionary
                    .reset_communication(&self.initial);
                return self.boot(port).await;
            }
        };
        Ok(())
    }

    /// Begins, changes or ends the heartbeat as 1017h says.
    fn set_beat(&mut self) {
        let time = lock(&self.shared).dictionary.number(HEARTBEAT_TIME);
        let period = Duration::from_millis(time.into());
        match self.next_beat {
            _ if period.is_zero() => self.next_beat = None,
            Some((same, _)) if same == period => {}
            _ => self.next_beat = Some((period, luna::now() + period)),
        }
    }

    fn beat(&mut self) -> Frame {
        if let Some((period, due)) = &mut self.next_beat {
            *due += *period;
        }
        let (node, state) = (self.id, self.state());
        Heartbeat { node, state }.frame()
    }

    fn handle(&mut self, received: &Frame) -> Vec<Frame> {
        let mut shared = lock(&self.shared);
        let Shared { state, dictionary } = &mut *shared;
        let Some(id) = received.standard_id() else {
            return Vec::new();
        };
        if id == self.id.sdo_request() && *state != NmtState::Stopped {
            let Ok(bytes) = received.data().try_into() else {
                return Vec::new();
            };
            let answer = self.transfer.answer(bytes, dictionary);
            let answer = answer.map(|answer| frame(self.id.sdo_response(), &answer.encode()));
            return answer.into_iter().collect();
        }
        if *state != NmtState::Operational {
            return Vec::new();
        }
        if received.is_remote() {
            return Vec::new();
        }
        if id == SYNC {
            let mut frames = Vec::new();
            for (number, since) in (0..).zip(&mut self.syncs) {
                let Some(pdo) = dictionary.pdo(0x1800, number) else {
                    continue;
                };
                if !(1..=240).contains(&pdo.transmission) {
                    continue;
                }
                *since += 1;
                if *since >= pdo.transmission {
                    *since = 0;
                    frames.push(content(&pdo, dictionary));
                }
            }
            return frames;
        }
        let pdos = (0..PDOS).filter_map(|number| dictionary.pdo(0x1400, number));
        if let Some(pdo) = pdos.into_iter().find(|pdo| pdo.id == id) {
            let mut rest = received.data();
            // One that is too short is for none of its objects; what is too long is left over.
            if pdo.objects.iter().map(|(_, len)| len).sum::<usize>() > rest.len() {
                return Vec::new();
            }
            for (object, len) in pdo.objects {
                let (own, later) = rest.split_at(len);
                dictionary.set(object, own);
                rest = later;
            }
        }
        Vec::new()
    }

    /// The PDOs that are sent when this object changes.
    fn changed(&self, object: Object) -> Vec<Frame> {
        let shared = lock(&self.shared);
        if shared.state != NmtState::Operational {
            return Vec::new();
        }
        let dictionary = &shared.dictionary;
        (0..PDOS)
            .filter_map(|number| dictionary.pdo(0x1800, number))
            .filter(|pdo| pdo.transmission >= 254)
            .filter(|pdo| pdo.objects.iter().any(|(of, _)| *of == object))
            .map(|pdo| content(&pdo, dictionary))
            .collect()
    }
}

fn content(pdo: &Pdo, dictionary: &Dictionary) -> Frame {
    let objects = pdo.objects.iter();
    let bytes: Vec<u8> = objects
        .flat_map(|(object, _)| dictionary.get(*object).unwrap_or_default())
        .copied()
        .collect();
    frame(pdo.id, &bytes)
}

/// Waits for the first of what can come.
async fn wait<P: Port>(
    port: &P,
    commands: &Receiver<Command>,
    due: Option<Instant>,
) -> Result<Wake, PortError> {
    let mut coming = pin!(port.receive());
    let mut commanded = pin!(commands.recv());
    let mut beat = pin!(async {
        match due {
            Some(due) => luna::at(due).await,
            None => std::future::pending().await,
        }
    });
    poll_fn(|cx| {
        if let Poll::Ready(came) = coming.as_mut().poll(cx) {
            return Poll::Ready(came.map(Wake::Came));
        }
        if let Poll::Ready(command) = commanded.as_mut().poll(cx) {
            return Poll::Ready(Ok(command.map_or(Wake::Ended, Wake::Commanded)));
        }
        beat.as_mut().poll(cx).map(|()| Ok(Wake::Beat))
    })
    .await
}

luna_platform::debug_fields!(impl[P: Port] Node<P>, |node| id: node.id, state: node.state());

luna_platform::debug_fields!(NodeControl, |control| id: control.id, state: control.state());
