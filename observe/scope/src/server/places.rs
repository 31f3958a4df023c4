//! The connections in one state, of which only a limited number may be there at a time.

use std::collections::VecDeque;
use std::io::{self, Read, Write};
use std::net::{Shutdown, TcpStream};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The places of one state. A connection that comes when all are taken gets the place of the
/// connection that came first, which is closed. So slow connections displace each other, and one
/// that does its part at once is served at any time.
#[derive(Debug)]
pub(crate) struct Places {
    most: usize,
    state: Mutex<State>,
    left: Condvar,
}

#[derive(Debug, Default)]
struct State {
    /// Those that were not closed, in the order in which they came.
    open: VecDeque<Arc<TcpStream>>,
    /// The closed ones too, until their threads have noticed.
    inside: usize,
}

/// A connection's place, which is free again when this is dropped.
#[derive(Debug)]
pub(crate) struct Place {
    places: Arc<Places>,
    stream: Arc<TcpStream>,
}

impl Places {
    pub(crate) fn new(most: usize) -> Self {
        Self {
            most,
            state: Mutex::default(),
            left: Condvar::new(),
        }
    }

    /// Takes a place. Waits for no client: only until the thread of a closed connection has
    /// returned from its call.
    pub(crate) fn enter(self: &Arc<Self>, stream: &Arc<TcpStream>) -> Place {
        let mut state = self.state();
        while state.inside >= self.most {
            // One is on its way out already unless all are open.
            if state.open.len() == state.inside
                && let Some(first) = state.open.pop_front()
            {
                // One that the client has closed cannot be shut down, and ends all the same.
                let _ = first.shutdown(Shutdown::Both);
            }
            let waited = self.left.wait(state);
            state = waited.unwrap_or_else(PoisonError::into_inner);
        }
        state.inside += 1;
        state.open.push_back(stream.clone());
        Place {
            places: self.clone(),
            stream: stream.clone(),
        }
    }

    fn state(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for Place {
    fn drop(&mut self) {
        let mut state = self.places.state();
        state.open.retain(|one| !Arc::ptr_eq(one, &self.stream));
        state.inside -= 1;
        self.places.left.notify_all();
    }
}

/// A connection until an instant, after which its calls fail.
pub(super) struct Until<'a> {
    pub(super) stream: &'a TcpStream,
    pub(super) end: Instant,
}

impl Until<'_> {
    pub(super) fn left(&self) -> io::Result<Duration> {
        let left = self.end.saturating_duration_since(Instant::now());
        match left.is_zero() {
            true => Err(io::ErrorKind::TimedOut.into()),
            false => Ok(left),
        }
    }
}

impl Read for Until<'_> {
    fn read(&mut self, to: &mut [u8]) -> io::Result<usize> {
        self.stream.set_read_timeout(Some(self.left()?))?;
        self.stream.read(to)
    }
}

impl Write for Until<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.stream.set_write_timeout(Some(self.left()?))?;
        self.stream.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.stream.flush()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::net::TcpListener;

    /// Both ends of a connection.
    fn pair() -> (TcpStream, Arc<TcpStream>) {
        let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
        let client = TcpStream::connect(listener.local_addr().unwrap()).unwrap();
        (client, Arc::new(listener.accept().unwrap().0))
    }

    #[test]
    fn the_first_to_come_gives_its_place() {
        let places = Arc::new(Places::new(2));
        std::thread::scope(|threads| {
            let mut clients = Vec::new();
            for _ in 0..50 {
                let (client, stream) = pair();
                clients.push(client);
                let (entered, enters) = std::sync::mpsc::channel();
                let places = &places;
                threads.spawn(move || {
                    let _place = places.enter(&stream);
                    entered.send(()).unwrap();
                    // It says nothing, and ends when it is closed.
                    let _ = (&*stream).read(&mut [0; 8]);
                });
                enters.recv().unwrap();
                assert!(places.state().inside <= 2);
            }
            // The last two are open: they end by themselves.
            for mut client in clients.drain(..48) {
                assert_eq!(client.read(&mut [0; 8]).unwrap(), 0);
            }
            assert_eq!(places.state().open.len(), 2);
        });
        assert_eq!(places.state().inside, 0);
    }

    #[test]
    fn a_connection_has_so_much_time_in_all() {
        let (_client, stream) = pair();
        let mut until = Until {
            stream: &stream,
            end: Instant::now(),
        };
        let late = io::ErrorKind::TimedOut;
        assert_eq!(until.read(&mut [0; 8]).unwrap_err().kind(), late);
        assert_eq!(until.write(&[0; 8]).unwrap_err().kind(), late);
    }
}
