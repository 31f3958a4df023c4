//! What a process needs to wait for files can be made when its body is: off the real-time path.

#![cfg(all(unix, not(loom)))]

use crate::file_support;
use crate::support;
use file_support::{pair, read_byte, with_files, write_byte};
use luna_core::current;
use luna_core::{Exit, OsThread, ProcessSpec, prepare_files};
use luna_platform::thread::Attributes;
use support::executor;

#[test]
fn at_both_kinds_of_places() {
    let Some(_watch) = with_files() else { return };
    let (near, far) = pair();
    let executor = executor();
    let asks = executor.spawn(ProcessSpec::new("asks"), move || {
        assert!(!current::on_path());
        prepare_files().unwrap();
        async move {
            write_byte(&near, 7).await.unwrap();
            assert_eq!(read_byte(&near).await, Ok(Some(8)));
        }
    });
    let thread = OsThread::start(
        Attributes::new("answers"),
        ProcessSpec::new("answers"),
        move || {
            assert!(!current::on_path());
            prepare_files().unwrap();
            async move {
                assert_eq!(read_byte(&far).await, Ok(Some(7)));
                write_byte(&far, 8).await.unwrap();
            }
        },
    )
    .unwrap();
    executor.release();
    thread.release();
    assert_eq!(asks.wait(), Exit::Completed);
    assert_eq!(thread.process().wait(), Exit::Completed);
}
