//! CAN: frames as the values of channels, over an interface of the kernel or a simulated bus; and
//! CANopen basics on top ([`canopen`]).
//!
//! | bus | opened by | what waits for it |
//! | --- | --- | --- |
//! | an interface of the kernel (SocketCAN): `can0`, `vcan0` | [`open()`] | the executor, as for any file |
//! | a simulated one, for tests | [`sim::Bus::open`] | the executor, on any clock |
//! | one of your own | a [`Port`] in the [device manager](luna::devices) | what you say |
//!
//! A [`Controller`] is the process between a port and channels; it is the same for all of them.
//! [`sim`] has an example, which with `luna_can::open(&system.devices(), "can0")` is one for
//! hardware.
//!
//! | what happens | the controller |
//! | --- | --- |
//! | a receiver's channel is full | drops the frame, counts it, reports the first ([`Event::Overrun`]) |
//! | a frame does not decode ([`Controller::receive_as`]) | the same ([`Event::Malformed`]) |
//! | the kernel's or the hardware's queue was full | counts and reports what was lost ([`Event::Lost`]) |
//! | an error on the bus; another error state | counts and reports it; the hardware repeats the frame |
//! | bus-off | the device is lost: an emergency by default; or it waits, and drops what is to be sent ([`OnBusOff`]) |
//! | the interface is down or gone | the device is lost |
//! | the bus takes no frames | a frame waits in the queue of the kernel, then its sender waits |
//!
//! **In an emergency** no process runs. A function that is registered with
//! [`Device::on_emergency`](luna::devices::Device::on_emergency) can send a frame with
//! [`Port::transmit_at_once`]; check its result, and panic if it fails, so that the report says it.
//!
//! CAN FD is not supported. SocketCAN has been run on no hardware yet; where the kernel has a
//! virtual interface the tests use that.

pub mod canopen;
mod controller;
mod counts;
mod filter;
mod frame;
mod port;
pub mod sim;
#[cfg(all(feature = "socketcan", target_os = "linux"))]
mod socket;

pub use controller::{CanError, Controller, Event, OnBusOff, controller};
pub use counts::Counts;
pub use embedded_can::{ExtendedId, Id, StandardId};
pub use filter::Filter;
pub use frame::Frame;
pub use port::{BusError, BusReport, Incoming, Port, PortError, State};
#[cfg(all(feature = "socketcan", target_os = "linux"))]
pub use socket::{OpenError, Socket, open};
