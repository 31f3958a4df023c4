//! A writer, the owner, and another reader, in any order: nobody sees parts of two values, the owner sees a value until it takes a new one, and the last one is never lost.

use super::*;
use crate::sync::Arc;

/// A value of two words, three times.
struct Scene {
    slots: ThreeSlots,
    words: [[AtomicU64; 2]; 3],
}

impl Scene {
    fn new() -> Arc<Self> {
        Arc::new(Self {
            slots: ThreeSlots::new(),
            words: std::array::from_fn(|_| std::array::from_fn(|_| AtomicU64::new(1))),
        })
    }

    fn put(&self, value: u64) {
        self.slots.publish(value, |slot| {
            for word in &self.words[slot] {
                word.store(value, Ordering::Release);
            }
        });
    }

    /// As the owner does it.
    fn own(&self) -> [u64; 2] {
        let slot = self.slots.front();
        std::array::from_fn(|word| self.words[slot][word].load(Ordering::Relaxed))
    }

    fn other(&self) -> [u64; 2] {
        self.slots
            .read(|slot| std::array::from_fn(|word| self.words[slot][word].load(Ordering::Acquire)))
    }
}

#[test]
fn the_owner_sees_whole_values_in_their_order_and_at_last_the_last() {
    loom::model(|| {
        let scene = Scene::new();
        let writer = scene.clone();
        let writes = loom::thread::spawn(move || {
            for value in 2..=4 {
                writer.put(value);
            }
        });
        let mut last = 1;
        for _ in 0..2 {
            scene.slots.latch();
            let [first, second] = scene.own();
            assert_eq!(first, second);
            assert!(first >= last);
            last = first;
            // As long as it takes no new one.
            assert_eq!(scene.own(), [last; 2]);
        }
        writes.join().unwrap();
        scene.slots.latch();
        assert_eq!((scene.own(), scene.slots.number()), ([4; 2], 4));
    });
}

#[test]
fn another_reader_sees_no_parts_of_two_values() {
    loom::model(|| {
        let scene = Scene::new();
        let (writer, other) = (scene.clone(), scene.clone());
        let writes = loom::thread::spawn(move || {
            writer.put(2);
            writer.put(3);
        });
        let reads = loom::thread::spawn(move || {
            let [first, second] = other.other();
            assert_eq!(first, second);
        });
        scene.slots.latch();
        scene.slots.latch();
        writes.join().unwrap();
        reads.join().unwrap();
    });
}

/// The slot that it looks at may be given away and written again at any moment.
#[test]
fn another_reader_never_runs_ahead_of_the_owner() {
    loom::model(|| {
        let scene = Scene::new();
        scene.put(2);
        let (writer, other) = (scene.clone(), scene.clone());
        let writes = loom::thread::spawn(move || {
            writer.put(3);
            writer.put(4);
        });
        let reads = loom::thread::spawn(move || other.other()[0]);
        scene.slots.latch();
        let taken = scene.slots.number();
        writes.join().unwrap();
        let read = reads.join().unwrap();
        assert!(read == 1 || read == taken, "{read}, but {taken} was taken");
    });
}
