use super::*;

/// Never admits again, or always.
const LONG: Duration = Duration::MAX;
const OVER: Duration = Duration::ZERO;

/// The handler's reports, in order.
#[derive(Default)]
struct Said {
    lines: Mutex<Vec<String>>,
    /// Whether sinks can be created, and take blocks.
    opens: AtomicBool,
    takes: Arc<AtomicBool>,
}

impl Said {
    fn say(&self, line: impl Into<String>) {
        lock(&self.lines).push(line.into());
    }

    fn take(&self) -> Vec<String> {
        std::mem::take(&mut *lock(&self.lines))
    }
}

struct Door(Arc<AtomicBool>);

impl Sink for Door {
    fn begin(&mut self, _head: &[u8]) -> io::Result<()> {
        Ok(())
    }

    fn block(&mut self, _block: &[u8]) -> io::Result<()> {
        match self.0.load(Ordering::Relaxed) {
            true => Ok(()),
            false => Err(io::Error::other("the file is full")),
        }
    }
}

impl Handler for Said {
    fn open(&self, _peer: &Peer) -> io::Result<Box<dyn Sink>> {
        self.say("open");
        match self.opens.load(Ordering::Relaxed) {
            true => Ok(Box::new(Door(self.takes.clone()))),
            false => Err(io::Error::other("there is no file")),
        }
    }

    fn is_back(&self, _peer: &Peer) {
        self.say("is back");
    }

    fn has_gone(&self, _peer: &Peer, departure: &Departure) {
        self.say(format!("has gone: {:?}", departure.error));
    }
}

fn office(said: &Arc<Said>) -> Office {
    Office {
        keeps_out: LONG,
        ..Office::new(said.clone())
    }
}

fn hello() -> Hello {
    Hello {
        key: Key {
            session: 7,
            part: 0,
        },
        next: 0,
        started: 0,
        process: 1,
        system: "test".to_owned(),
    }
}

fn address() -> SocketAddr {
    SocketAddr::from(([127, 0, 0, 1], 1))
}

fn block() -> Vec<u8> {
    let mut encoder = Encoder::new();
    encoder.put(&Record::Epoch { time: 0, unix: 0 });
    encoder.block().to_vec()
}

/// Enters, sends a block, and leaves if the block is not taken.
fn visit(office: &Office) -> Result<bool, Refusal> {
    let (visit, known) = office.enter(&hello(), address())?;
    let outcome = lock(&known).block(&mut block());
    let error = outcome.err().map(|error| error.to_string());
    let is_taken = error.is_none();
    office.leave(visit, &known, error);
    Ok(is_taken)
}

#[test]
fn a_sender_without_room_is_reported_once() {
    let said = Arc::new(Said::default());
    let mut office = office(&said);
    said.opens.store(true, Ordering::Relaxed);
    assert!(matches!(visit(&office), Ok(false)));
    let gone = "has gone: Some(\"the file is full\")";
    assert_eq!(said.take(), ["open", gone]);
    for _ in 0..3 {
        // It is refused at first, and later admitted for a trial.
        let refusal = visit(&office).expect_err("there is no room");
        assert!(refusal.error == PeerError::NoRoom && refusal.is_reported);
        office.keeps_out = OVER;
        assert!(matches!(visit(&office), Ok(false)));
        office.keeps_out = LONG;
    }
    assert_eq!(said.take(), [""; 0]);

    said.takes.store(true, Ordering::Relaxed);
    office.keeps_out = OVER;
    assert!(matches!(visit(&office), Ok(true)));
    assert_eq!(said.take(), ["is back", "has gone: None"]);
    assert!(matches!(visit(&office), Ok(true)));
    assert_eq!(said.take(), ["is back", "has gone: None"]);
}

#[test]
fn a_sender_without_a_sink_waits_before_it_gets_another() {
    let said = Arc::new(Said::default());
    let mut office = office(&said);
    said.takes.store(true, Ordering::Relaxed);
    let refusal = visit(&office).expect_err("it gets no sink");
    assert!(refusal.error == PeerError::NoRoom && !refusal.is_reported);
    assert_eq!(said.take(), ["open"]);
    let refusal = visit(&office).expect_err("it gets none yet");
    assert!(refusal.error == PeerError::NoRoom && refusal.is_reported);
    assert_eq!(said.take(), [""; 0]);
    said.opens.store(true, Ordering::Relaxed);
    office.keeps_out = OVER;
    assert!(matches!(visit(&office), Ok(true)));
    assert_eq!(said.take(), ["open", "has gone: None"]);
}
