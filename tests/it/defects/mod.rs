//! Programs that showed a defect, each by the public interface alone. They are run under AddressSanitizer too, where a defect of memory shows that is silent here.

#![cfg(target_os = "linux")]

mod held_send;
mod lock_drop;
mod select_drop;
mod waker;
