//! What interrupts make and drop: channels, values, processes.

use luna_bare::cpu;
use luna_channels::{Buffer, buffered, channel, inspect};
use luna_core::deferred_free;
use luna_core::{Executor, Exit, ProcessSpec};
use luna_platform::bare;
use luna_platform::clock::Instant;
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// The numbers of the live channels, which rise in the order in which they are listed.
fn numbers() -> Vec<u64> {
    let numbers: Vec<u64> = inspect::wait_points().iter().map(|one| one.id).collect();
    assert!(numbers.is_sorted_by(|one, next| one < next), "{numbers:?}");
    numbers
}

#[test]
fn channels_are_made_and_dropped_by_the_program_and_by_interrupts() {
    for seed in 0..50 {
        // What other tests have left is freed, and no interrupt comes yet.
        cpu::begin(seed, 0);
        deferred_free::collect();
        let before = numbers().len();
        cpu::begin(seed, 3);
        let made = Rc::new(Cell::new(0));
        for priority in [1, 2] {
            let (counts, mut kept) = (made.clone(), VecDeque::new());
            let work = RefCell::new(move || {
                let (sender, receiver) = buffered(Buffer::fifo(1));
                let number = counts.replace(counts.get() + 1);
                sender.try_send(number).unwrap();
                assert_eq!(receiver.try_recv(), Ok(number));
                kept.push_back((sender, receiver));
                if kept.len() > 3 {
                    kept.pop_front();
                }
            });
            cpu::add_interrupt(priority, move || {
                work.borrow_mut()();
                true
            });
        }
        for _ in 0..5 {
            let (first, second, third) = (channel::<u32>(), channel::<u32>(), channel::<u32>());
            assert!(numbers().len() >= before + 3);
            drop((second, first));
            assert!(numbers().len() > before);
            drop(third);
        }
        assert!(made.get() > 0);
        // The interrupts are gone, with the channels that they kept.
        cpu::begin(seed, 0);
        deferred_free::collect();
        assert_eq!(numbers().len(), before, "seed {seed}");
    }
}

#[test]
fn what_a_process_drops_is_freed_when_it_collects() {
    cpu::begin(1, 0);
    deferred_free::collect();
    let before = numbers().len();
    let executor = Executor::new();
    executor.spawn(ProcessSpec::new("process"), move || async move {
        for _ in 0..100 {
            drop(channel::<u32>());
        }
        assert_eq!(numbers().len(), before + 100);
        deferred_free::collect();
        assert_eq!(numbers().len(), before);
    });
    executor.run();
}

#[test]
fn values_are_dropped_where_the_last_receiver_goes_or_another_value_displaces_them() {
    cpu::begin(1, 0);
    let token = Arc::new(());
    let (sender, receiver) = buffered(Buffer::overwrite_oldest(2));
    for _ in 0..2 {
        sender.try_send(token.clone()).unwrap();
    }
    let (another, counts) = (token.clone(), token.clone());
    assert_eq!(Arc::strong_count(&token), 5);
    bare::interrupt(|| {
        sender.try_send(another).unwrap();
        assert_eq!(Arc::strong_count(&counts), 4, "one was displaced");
        drop(receiver);
        assert_eq!(Arc::strong_count(&counts), 2);
    });
}

#[test]
fn a_value_is_made_by_the_interrupt_that_takes_it_and_no_other_one_comes() {
    cpu::begin(1, 1);
    let (sender, receiver) = channel();
    let (taken, nested) = (Rc::new(Cell::new(0)), Arc::new(AtomicU32::new(0)));
    let takes = taken.clone();
    cpu::add_interrupt(1, move || {
        if let Ok(value) = receiver.try_recv() {
            assert_eq!(value, takes.replace(value) + 1);
        }
        taken.get() < 20
    });
    let comes = nested.clone();
    cpu::add_interrupt(2, move || {
        comes.fetch_add(1, Ordering::Relaxed);
        true
    });
    let executor = Executor::new();
    executor.spawn(ProcessSpec::new("process"), move || async move {
        for value in 1..=20 {
            let nested = nested.clone();
            let make = move || {
                assert!(bare::is_interrupt());
                let before = nested.load(Ordering::Relaxed);
                // Elsewhere an interrupt comes at each of these.
                let (start, end) = (Instant::now(), Instant::now());
                assert!(end > start);
                assert_eq!(nested.load(Ordering::Relaxed), before);
                value
            };
            sender.send_with(make).await.unwrap();
        }
    });
    executor.run();
}

#[test]
fn a_process_that_an_interrupt_spawns_runs_unless_it_is_given_back() {
    let (mut ran, mut refused) = (0, 0);
    // The interrupt comes at the `place` after the last process has ended.
    for place in 0..60 {
        cpu::begin(1, 1);
        let executor = Executor::new();
        let has_ended = Arc::new(AtomicBool::new(false));
        let (handle, watched) = (executor.handle().clone(), has_ended.clone());
        let (places, result) = (Cell::new(0), Rc::new(RefCell::new(None)));
        let spawned = result.clone();
        cpu::add_interrupt(1, move || {
            if !watched.load(Ordering::Relaxed) || places.replace(places.get() + 1) < place {
                return true;
            }
            let (announced, process) = handle.announce(ProcessSpec::new("late"), || async {});
            *spawned.borrow_mut() = Some((announced.start().is_none(), process));
            false
        });
        executor.spawn(ProcessSpec::new("first"), move || async move {
            has_ended.store(true, Ordering::Relaxed);
        });
        executor.run();
        if let Some((is_taken, process)) = result.borrow_mut().take() {
            let expected = if is_taken {
                Exit::Completed
            } else {
                Exit::Cancelled
            };
            assert_eq!(process.exit(), Some(expected), "at place {place}");
            *(if is_taken { &mut ran } else { &mut refused }) += 1;
        }
    }
    assert!(ran > 0 && refused > 0, "{ran} {refused}");
}
