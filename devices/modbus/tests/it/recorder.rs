//! A server that writes down what is written to it, and fails as the value says.

use std::io::{Read, Write};
use std::net::{SocketAddr, TcpListener, TcpStream};
use std::thread::{self, JoinHandle};

/// What the server does with a value: by its remainder by 5.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Treatment {
    /// It takes it, and confirms that.
    Confirm,
    /// It hangs up before it takes it.
    HangUp,
    /// It takes it, and does not answer.
    Silent,
    /// It takes it, and answers with garbage.
    Garbage,
    /// It takes it, and answers by exception 5, which does not exclude that.
    Acknowledge,
}

impl Treatment {
    pub(crate) fn of(value: u16) -> Self {
        match value % 5 {
            1 => Treatment::HangUp,
            2 => Treatment::Silent,
            3 => Treatment::Garbage,
            4 => Treatment::Acknowledge,
            _ => Treatment::Confirm,
        }
    }
}

/// Serves one connection after the other, so that what it takes is in the order of requests. It
/// ends after the connection over which `last` came; its result is what it has taken.
pub(crate) fn start(last: u16) -> (SocketAddr, JoinHandle<Vec<u16>>) {
    let listener = TcpListener::bind(("127.0.0.1", 0)).unwrap();
    let address = listener.local_addr().unwrap();
    let serving = thread::spawn(move || {
        let mut taken = Vec::new();
        while taken.last() != Some(&last) {
            let (stream, _) = listener.accept().unwrap();
            // It ends when one side has hung up.
            let _ = serve(stream, &mut taken);
        }
        taken
    });
    (address, serving)
}

fn serve(mut stream: TcpStream, taken: &mut Vec<u16>) -> std::io::Result<()> {
    loop {
        // "Write single register" is of this length.
        let mut request = [0; 12];
        stream.read_exact(&mut request)?;
        assert_eq!(request[7], 6);
        let value = u16::from_be_bytes([request[10], request[11]]);
        let treatment = Treatment::of(value);
        if treatment == Treatment::HangUp {
            return Ok(());
        }
        taken.push(value);
        match treatment {
            Treatment::Silent => {}
            Treatment::Garbage => stream.write_all(&[1; 12])?,
            Treatment::Acknowledge => {
                let header = [request[0], request[1], 0, 0, 0, 3];
                stream.write_all(&[&header[..], &[request[6], 0x86, 5]].concat())?;
            }
            _ => stream.write_all(&request)?,
        }
    }
}
