//! Programs that showed a defect, each by the public interface alone. They also run under
//! AddressSanitizer, which shows memory defects that are silent here.

#![cfg(target_os = "linux")]

mod held_send;
mod lock_drop;
mod select_drop;
mod waker;
