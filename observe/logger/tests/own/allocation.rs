//! Logging does not allocate on a prepared thread. Only allocations of this thread count.

use luna_logger::{Hub, Level, Logging, Recorder, Signal, WriterSink, message};
use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::io::{self, Write};
use std::sync::mpsc::{Receiver, Sender, channel};

struct Counting;

thread_local! {
    static COUNTED: Cell<u64> = const { Cell::new(0) };
}

fn count() {
    COUNTED.set(COUNTED.get() + 1);
}

// SAFETY: each call is passed on unchanged to the system's allocator.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        count();
        // SAFETY: the caller promises a layout that is not of size 0, which is passed on.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        count();
        // SAFETY: all calls are passed on, so the system's allocator made the block, and with this
        // layout.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Reports at the first byte of a block that it waits, and waits until the other end is dropped.
struct Stalled(Sender<()>, Receiver<()>, bool);

impl Write for Stalled {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        // The head is written by the thread that starts the recording.
        if std::mem::replace(&mut self.2, true) {
            let _ = self.0.send(());
            let _ = self.1.recv();
        }
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

#[test]
fn samples_and_messages_allocate_nothing_also_when_there_is_no_room() {
    let hub = Hub::new("allocation", Default::default());
    let ((waits, waiting), (open, gate)) = (channel(), channel::<()>());
    let recording = Logging::to_sink(WriterSink::new(Stalled(waits, gate, false)));
    // So little room that most is lost.
    let recorder =
        Recorder::start(&hub, recording.room_for_samples(50).room_for_messages(600)).unwrap();
    // From here on nothing is moved out of the rings.
    waiting.recv().unwrap();
    hub.enter_thread();
    let registering = hub.enter();
    let one = Signal::<f64>::register("one").unwrap();
    let many = Signal::<[u16; 16]>::register("many").unwrap();
    drop(registering);
    let before = COUNTED.get();
    for n in 0..10_000u16 {
        one.record(n.into());
        many.record([n; 16]);
        message(
            Level::Info,
            "test",
            format_args!("number {n} of {}", 10_000),
        );
        let copy = one.clone();
        copy.record(0.5);
    }
    let after = COUNTED.get();
    assert_eq!(after - before, 0);
    let control = Box::new(1);
    assert!(COUNTED.get() > after, "it counts: {control}");
    drop(open);
    let report = recorder.finish();
    assert_eq!(report.signals[0].recorded + report.signals[0].lost, 20_000);
    assert!(report.lost_samples() > 0 && report.messages.lost > 0);
}

#[test]
fn a_message_on_the_path_of_a_thread_that_is_in_no_hub_allocates_nothing() {
    let thread = std::thread::spawn(|| {
        luna_core::current::set_on_path(true);
        let before = COUNTED.get();
        message(Level::Info, "test", format_args!("lost"));
        let counted = COUNTED.get() - before;
        luna_core::current::set_on_path(false);
        counted
    });
    assert_eq!(thread.join().unwrap(), 0);
}
