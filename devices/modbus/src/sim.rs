//! A simulated server on loopback, for tests and examples.
//!
//! It has 1 000 of each: coils, discrete inputs, input and holding registers; all are 0. It answers
//! any unit. Its functions are 1 to 6, 15 and 16; a request has at most 256 bytes, so 120 registers
//! are written at once. Its threads wait in system calls: it is no part of a system, and needs real time.

use crate::point::{Source, Value};
use crate::{Code, Table};
use rmodbus::server::ModbusFrame;
use rmodbus::server::context::ModbusContext;
use rmodbus::server::storage::ModbusStorage;
use rmodbus::{ErrorKind, ModbusProto};
use std::collections::HashMap;
use std::io::{self, Read, Write};
use std::net::{Shutdown, SocketAddr, TcpListener, TcpStream};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::Duration;

/// How many points each table has.
pub const SIZE: usize = 1_000;

type Storage = ModbusStorage<SIZE, SIZE, SIZE, SIZE>;

/// What the server does wrong from now on.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
#[non_exhaustive]
pub enum Fault {
    /// Nothing.
    #[default]
    None,
    /// It answers so much later, and has done what was asked by then.
    Slow(Duration),
    /// It takes requests, does what they ask, and does not answer.
    Silent,
    /// It refuses all that is asked.
    Refuses(Code),
    /// It answers with these bytes.
    Garbage(Vec<u8>),
    /// It sends these bytes before each answer.
    Before(Vec<u8>),
    /// It answers as this unit, whichever was asked.
    Unit(u8),
    /// It hangs up when it is asked, before it does it.
    HangsUp,
}

/// A simulated server. It stops when it is dropped.
pub struct Server {
    address: SocketAddr,
    shared: Arc<Shared>,
    listening: Option<JoinHandle<()>>,
}

struct Shared {
    state: Mutex<State>,
}

struct State {
    storage: Box<Storage>,
    fault: Fault,
    requests: u64,
    is_stopped: bool,
    /// Those that are open, by their numbers.
    connections: HashMap<u64, TcpStream>,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Server {
    /// Starts a server at a free port.
    ///
    /// # Errors
    ///
    /// The system's error.
    pub fn start() -> io::Result<Server> {
        Self::start_at(SocketAddr::from(([127, 0, 0, 1], 0)))
    }

    /// Starts a server at an address: that of one that was [stopped](Self::stop), say.
    ///
    /// # Errors
    ///
    /// The system's error.
    pub fn start_at(address: SocketAddr) -> io::Result<Server> {
        let listener = TcpListener::bind(address)?;
        let address = listener.local_addr()?;
        let shared = Arc::new(Shared {
            state: Mutex::new(State {
                storage: Box::new(Storage::new()),
                fault: Fault::None,
                requests: 0,
                is_stopped: false,
                connections: HashMap::new(),
            }),
        });
        let own = shared.clone();
        let listening = thread::spawn(move || listen(&listener, &own));
        Ok(Server {
            address,
            shared,
            listening: Some(listening),
        })
    }

    /// Where it listens.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// Sets a value; the inputs too.
    ///
    /// # Errors
    ///
    /// There is no such address here: it is beyond [`SIZE`].
    pub fn set<T: Value>(&self, source: impl Into<Source<T>>, value: T) -> io::Result<()> {
        let source = source.into();
        let raw = value.encode(source.order);
        let at = source.place.address;
        let mut state = self.shared.state();
        let storage = &mut state.storage;
        let words = &raw[..source.place.width.into()];
        let set = match source.place.table {
            Table::Coil => storage.set_coil(at, raw[0] != 0),
            Table::Discrete => storage.set_discrete(at, raw[0] != 0),
            Table::Input => storage.set_inputs_bulk(at, words),
            Table::Holding => storage.set_holdings_bulk(at, words),
        };
        set.map_err(beyond)
    }

    /// Reads a value.
    ///
    /// # Errors
    ///
    /// As [`set`](Self::set).
    pub fn get<T: Value>(&self, source: impl Into<Source<T>>) -> io::Result<T> {
        let source = source.into();
        let (at, width) = (source.place.address, source.place.width);
        let state = self.shared.state();
        let storage = &state.storage;
        let mut raw = Vec::with_capacity(2);
        let got = match source.place.table {
            Table::Coil => storage.get_coil(at).map(|bit| raw.push(bit.into())),
            Table::Discrete => storage.get_discrete(at).map(|bit| raw.push(bit.into())),
            Table::Input => storage.get_inputs_bulk(at, width, &mut raw),
            Table::Holding => storage.get_holdings_bulk(at, width, &mut raw),
        };
        got.map_err(beyond)?;
        Ok(T::decode(&raw, source.order))
    }

    /// Sets what it does wrong with the next requests.
    pub fn fault(&self, fault: Fault) {
        self.shared.state().fault = fault;
    }

    /// How many requests have come.
    pub fn requests(&self) -> u64 {
        self.shared.state().requests
    }

    /// Closes all connections and the port.
    pub fn stop(self) {}
}

impl Drop for Server {
    fn drop(&mut self) {
        {
            let mut state = self.shared.state();
            state.is_stopped = true;
            for (_, connection) in state.connections.drain() {
                let _ = connection.shutdown(Shutdown::Both);
            }
        }
        // It wakes the thread that accepts, if the system lets it.
        if TcpStream::connect(self.address).is_ok()
            && let Some(listening) = self.listening.take()
        {
            // It has not panicked: nothing in it does.
            let _ = listening.join();
        }
    }
}

luna_platform::debug_fields!(Server, |server| address: server.address, requests: server.requests());

fn beyond(_: ErrorKind) -> io::Error {
    let text = format!("the simulated server has addresses from 0 to {}", SIZE - 1);
    io::Error::new(io::ErrorKind::InvalidInput, text)
}

fn listen(listener: &TcpListener, shared: &Arc<Shared>) {
    let mut number = 0;
    while let Ok((stream, _)) = listener.accept() {
        let Ok(other) = stream.try_clone() else {
            continue;
        };
        {
            let mut state = shared.state();
            if state.is_stopped {
                return;
            }
            number += 1;
            state.connections.insert(number, other);
        }
        let shared = shared.clone();
        thread::spawn(move || {
            let _ = serve(&stream, &shared);
            shared.state().connections.remove(&number);
            let _ = stream.shutdown(Shutdown::Both);
        });
    }
}

/// Answers until the client hangs up.
fn serve(mut stream: &TcpStream, shared: &Shared) -> io::Result<()> {
    stream.set_nodelay(true)?;
    loop {
        // A header, and what it says that follows: the unit, the function, and more.
        let mut request = [0; 260];
        stream.read_exact(&mut request[..6])?;
        let len = 6 + usize::from(u16::from_be_bytes([request[4], request[5]]));
        if !(8..=request.len()).contains(&len) {
            return Ok(());
        }
        stream.read_exact(&mut request[6..len])?;
        // Of another protocol than Modbus: the standard has it discarded.
        if request[2..4] != [0, 0] {
            continue;
        }
        let (mut answer, fault) = {
            let mut state = shared.state();
            state.requests += 1;
            let fault = state.fault.clone();
            match &fault {
                Fault::HangsUp => return Ok(()),
                Fault::Refuses(code) => (refusal(&request, *code), fault),
                _ => (answer(&request[..len], &mut state.storage), fault),
            }
        };
        match fault {
            Fault::Silent => {}
            Fault::Slow(time) => {
                thread::sleep(time);
                stream.write_all(&answer)?;
            }
            Fault::Garbage(bytes) => stream.write_all(&bytes)?,
            Fault::Before(bytes) => stream.write_all(&[bytes, answer].concat())?,
            Fault::Unit(unit) => {
                if let Some(of) = answer.get_mut(6) {
                    *of = unit;
                }
                stream.write_all(&answer)?;
            }
            _ => stream.write_all(&answer)?,
        }
    }
}

fn refusal(request: &[u8], code: Code) -> Vec<u8> {
    let [transaction @ .., unit, function] = &request[..8] else {
        return Vec::new();
    };
    let mut answer = vec![transaction[0], transaction[1], 0, 0, 0, 3];
    answer.extend([*unit, function | 0x80, code.number()]);
    answer
}

fn answer(request: &[u8], storage: &mut Storage) -> Vec<u8> {
    let (unit, function) = (request[6], request[7]);
    // rmodbus looks at the length of a request before its function.
    if !matches!(function, 1..=6 | 15 | 16) {
        return refusal(request, Code::IllegalFunction);
    }
    // rmodbus relies on the number of bytes that a write of several states.
    let follow = request.get(12).map_or(0, |count| usize::from(*count));
    if matches!(function, 15 | 16) && request.len() != 13 + follow {
        return refusal(request, Code::IllegalValue);
    }
    let mut answer = Vec::new();
    let mut frame =
        ModbusFrame::new(unit, request, ModbusProto::TcpUdp, &mut answer).with_broadcast_units(&[]);
    let done = frame.parse().and_then(|()| {
        if frame.processing_required {
            match frame.readonly {
                true => frame.process_read(storage),
                false => frame.process_write(storage),
            }?;
        }
        frame.finalize_response()
    });
    match done {
        Ok(()) => answer,
        Err(_) => refusal(request, Code::IllegalValue),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_connection_that_has_ended_is_not_kept() {
        let server = Server::start().unwrap();
        for _ in 0..3 {
            let mut stream = TcpStream::connect(server.address()).unwrap();
            stream.shutdown(Shutdown::Write).unwrap();
            // The server closes it last.
            assert_eq!(stream.read(&mut [0]).unwrap(), 0);
            assert!(server.shared.state().connections.is_empty());
        }
    }
}
