//! What goes wrong.

use crate::Table;
use luna::external::{FileError, OsError};
use std::fmt;
use std::time::Duration;

/// A client cannot be set up so.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum SetUpError {
    /// The value does not fit before the end of its table.
    #[error("a value of 32 bits at {table} {address} would need one more, and there is none")]
    PastTheEnd {
        /// In which table.
        table: Table,
        /// From which address on.
        address: u16,
    },
    /// A period or a timeout of zero.
    #[error("the {what} of a Modbus client is greater than zero")]
    Zero {
        /// Which of them.
        what: &'static str,
    },
}

impl From<SetUpError> for luna::Error {
    fn from(error: SetUpError) -> Self {
        luna::Error::other(error)
    }
}

/// What was asked of the server.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub struct Request {
    /// The number of the function in the protocol: 1 to 6, 15 or 16.
    pub function: u8,
    /// In which table.
    pub table: Table,
    /// The first address.
    pub address: u16,
    /// The number of bits or registers.
    pub count: u16,
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            function,
            table,
            address,
            count,
        } = self;
        write!(f, "function {function}, {table} {address}")?;
        match count {
            1 => Ok(()),
            _ => write!(f, " to {}", u32::from(*address) + u32::from(*count) - 1),
        }
    }
}

/// The code of an exception: why a server does not answer as asked.
///
/// By the protocol, codes 1, 2, 3, 6 and 10 say that nothing was done. After 4, 5, 8, 11 and codes
/// that it does not name, a write may have its effect, or a part of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Code {
    /// 1: the server has no such function.
    IllegalFunction,
    /// 2: it has no such address.
    IllegalAddress,
    /// 3: it does not take this value, or this count.
    IllegalValue,
    /// 4: it failed, maybe after a part was done.
    DeviceFailure,
    /// 5: it has accepted the request, and needs a long time for it.
    Acknowledge,
    /// 6: it is busy; ask again.
    Busy,
    /// 8: its memory has an error.
    MemoryParity,
    /// 10: a gateway has no path to the unit.
    NoPath,
    /// 11: the unit behind a gateway does not answer; it may have done what was asked.
    NoAnswerBehindGateway,
    /// A code that the protocol does not name.
    Other(u8),
}

impl Code {
    // rmodbus takes 9 and 10 for what are 10 and 11 in the protocol.
    pub(crate) fn of(code: u8) -> Self {
        match code {
            1 => Code::IllegalFunction,
            2 => Code::IllegalAddress,
            3 => Code::IllegalValue,
            4 => Code::DeviceFailure,
            5 => Code::Acknowledge,
            6 => Code::Busy,
            8 => Code::MemoryParity,
            10 => Code::NoPath,
            11 => Code::NoAnswerBehindGateway,
            other => Code::Other(other),
        }
    }

    /// The number in the protocol.
    pub fn number(self) -> u8 {
        match self {
            Code::IllegalFunction => 1,
            Code::IllegalAddress => 2,
            Code::IllegalValue => 3,
            Code::DeviceFailure => 4,
            Code::Acknowledge => 5,
            Code::Busy => 6,
            Code::MemoryParity => 8,
            Code::NoPath => 10,
            Code::NoAnswerBehindGateway => 11,
            Code::Other(other) => other,
        }
    }
}

impl fmt::Display for Code {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let meaning = match self {
            Code::IllegalFunction => "it has no such function",
            Code::IllegalAddress => "it has no such address",
            Code::IllegalValue => "it does not take this value",
            Code::DeviceFailure => "the device failed",
            Code::Acknowledge => "it has accepted, and needs a long time",
            Code::Busy => "it is busy",
            Code::MemoryParity => "its memory has an error",
            Code::NoPath => "the gateway has no path to the unit",
            Code::NoAnswerBehindGateway => "the unit behind the gateway does not answer",
            Code::Other(_) => "no code of the protocol",
        };
        write!(f, "exception {}: {meaning}", self.number())
    }
}

/// What is wrong with an answer.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum Garbage {
    /// The header is of no Modbus frame, or its length is impossible.
    #[error("its header is none of Modbus")]
    Header,
    /// The unit is another one than [`AnswerUnit`](crate::AnswerUnit) says.
    #[error("it comes from another unit: if the server is to answer so, state it by `answer_unit`")]
    Unit,
    /// The function is another one.
    #[error("it is of another function")]
    Function,
    /// It has more or fewer values than were asked for.
    #[error("it has another number of values")]
    Length,
    /// It confirms another write.
    #[error("it confirms another write")]
    Echo,
}

/// Why a request was not answered as it should be.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RequestError {
    /// The server answers by an exception. The connection stays.
    #[error("the server answers {request} by {code}")]
    Exception {
        /// What was asked.
        request: Request,
        /// Which one.
        code: Code,
    },
    /// No complete answer came in time. The connection is closed, since a late answer is of no use.
    #[error("no answer to {request} within {limit:?}")]
    TimedOut {
        /// What was asked.
        request: Request,
        /// How long was waited.
        limit: Duration,
    },
    /// The answer makes no sense. The connection is closed.
    #[error("the answer to {request} makes no sense: {why}")]
    Garbage {
        /// What was asked.
        request: Request,
        /// What is wrong.
        why: Garbage,
    },
    /// The server has closed the connection: in the request, or before it was sent.
    #[error("the server has hung up on {request}")]
    HungUp {
        /// What was asked.
        request: Request,
    },
    /// The connection fails.
    #[error("the connection fails in {request}: {error}")]
    Failed {
        /// What was asked.
        request: Request,
        /// The system's error.
        error: OsError,
    },
    /// It was not sent: there is no connection, and the client ends.
    #[error("no connection for {request}")]
    NotConnected {
        /// What was to be asked.
        request: Request,
    },
    /// The socket cannot be waited for.
    #[error("{error} (in {request})")]
    Wait {
        /// What was asked.
        request: Request,
        /// Why.
        error: FileError,
    },
}

impl RequestError {
    /// What was asked.
    pub fn request(&self) -> Request {
        match self {
            RequestError::Exception { request, .. }
            | RequestError::TimedOut { request, .. }
            | RequestError::Garbage { request, .. }
            | RequestError::HungUp { request }
            | RequestError::NotConnected { request }
            | RequestError::Failed { request, .. }
            | RequestError::Wait { request, .. } => *request,
        }
    }

    /// Whether the connection is of use after it.
    pub(crate) fn keeps_connection(&self) -> bool {
        matches!(self, RequestError::Exception { .. })
    }
}

/// What a client reports.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Event {
    /// There is a connection.
    Connected,
    /// The connection was closed for this reason; the client connects again. If a value was taken
    /// for the request, the event [`Event::WriteFailed`] came before.
    Disconnected(RequestError),
    /// The server refuses to be read so. This comes once for a request, until it succeeds or is
    /// refused with another code.
    ReadRefused(RequestError),
    /// A value that was taken from a channel was not confirmed. It is not written again. The server
    /// has not taken it after [`RequestError::NotConnected`], and after an exception whose [`Code`]
    /// says so; after any other error it may have.
    WriteFailed {
        /// The value; it is exact for all types.
        value: f64,
        /// Why, and where to.
        error: RequestError,
    },
}

impl fmt::Display for Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Event::Connected => f.write_str("connected"),
            Event::Disconnected(error) => write!(f, "disconnected: {error}"),
            Event::ReadRefused(error) => write!(f, "not read: {error}"),
            Event::WriteFailed { value, error } => {
                write!(f, "{value} was not confirmed: {error}")
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_report_of_a_write_does_not_say_more_than_is_known() {
        let request = Request {
            function: 6,
            table: Table::Holding,
            address: 3,
            count: 1,
        };
        let code = Code::Acknowledge;
        let event = Event::WriteFailed {
            value: 1.5,
            error: RequestError::Exception { request, code },
        };
        assert_eq!(
            event.to_string(),
            "1.5 was not confirmed: the server answers function 6, holding register 3 by exception 5: it has accepted, and needs a long time"
        );
    }
}
