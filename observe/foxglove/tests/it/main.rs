//! The server, seen by a viewer that speaks the protocol of Foxglove and Lichtblick.

mod live;
mod viewer;
